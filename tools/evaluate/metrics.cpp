#include "tools/evaluate/metrics.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numeric>
#include <string>
#include <utility>

#include <Eigen/SVD>

namespace nilio::tools::evaluate {

namespace {

// Ratio of the variances across and along the path (3 % in width) below which the rotation about the path is
// determined by errors.
constexpr double kMinSpreadRatio = 1e-3;
constexpr core::Duration kDefaultMaxGap{200'000'000};
constexpr core::Duration kDefaultMaxDifference{10'000'000};

std::string time_range(const Trajectory& trajectory) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), " covers %.3f .. %.3f s (%zu poses)",
                trajectory.stamps.front().seconds(), trajectory.stamps.back().seconds(),
                trajectory.stamps.size());
  return trajectory.path + text.data();
}

std::size_t nearest_index(const std::vector<core::Time>& stamps, core::Time stamp) {
  const auto next = std::lower_bound(stamps.begin(), stamps.end(), stamp);
  if (next == stamps.begin()) return 0;
  const auto j = static_cast<std::size_t>(next - stamps.begin());
  return next == stamps.end() || stamp - stamps[j - 1] <= stamps[j] - stamp ? j - 1 : j;
}

void associate_nearest(const Trajectory& truth, const Trajectory& estimate, core::Duration max_difference,
                       PosePairs& pairs) {
  const bool truth_is_longer = truth.stamps.size() > estimate.stamps.size();
  const Trajectory& shorter = truth_is_longer ? estimate : truth;
  const Trajectory& longer = truth_is_longer ? truth : estimate;
  std::vector<bool> used(longer.poses.size(), false);
  for (std::size_t i = 0; i < shorter.poses.size(); ++i) {
    const std::size_t j = nearest_index(longer.stamps, shorter.stamps[i]);
    const std::int64_t difference_ns = std::abs((shorter.stamps[i] - longer.stamps[j]).ns);
    if (difference_ns > max_difference.ns) continue;
    used[j] = true;
    pairs.truth.push_back(truth_is_longer ? longer.poses[j] : shorter.poses[i]);
    pairs.estimate.push_back(truth_is_longer ? shorter.poses[i] : longer.poses[j]);
    pairs.estimate_index.push_back(truth_is_longer ? i : j);
  }
  const std::size_t unmatched_shorter = shorter.poses.size() - pairs.truth.size();
  const auto unmatched_longer = static_cast<std::size_t>(std::count(used.begin(), used.end(), false));
  pairs.unmatched_truth = truth_is_longer ? unmatched_longer : unmatched_shorter;
  pairs.unmatched_estimate = truth_is_longer ? unmatched_shorter : unmatched_longer;
}

void associate_interpolated(const Trajectory& truth, const Trajectory& estimate, core::Duration max_gap,
                            PosePairs& pairs) {
  for (std::size_t i = 0; i < estimate.poses.size(); ++i) {
    const auto pose = interpolate_pose(truth, estimate.stamps[i], max_gap);
    if (!pose) continue;
    pairs.truth.push_back(*pose);
    pairs.estimate.push_back(estimate.poses[i]);
    pairs.estimate_index.push_back(i);
  }
  pairs.unmatched_estimate = estimate.poses.size() - pairs.estimate.size();
  const auto outside = [&](core::Time t) {
    return t < estimate.stamps.front() || t > estimate.stamps.back();
  };
  pairs.unmatched_truth =
      static_cast<std::size_t>(std::count_if(truth.stamps.begin(), truth.stamps.end(), outside));
}

void associate_by_index(const Trajectory& truth, const Trajectory& estimate, PosePairs& pairs) {
  const std::size_t n = std::min(truth.poses.size(), estimate.poses.size());
  pairs.truth.assign(truth.poses.begin(), truth.poses.begin() + static_cast<std::ptrdiff_t>(n));
  pairs.estimate.assign(estimate.poses.begin(), estimate.poses.begin() + static_cast<std::ptrdiff_t>(n));
  pairs.estimate_index.resize(n);
  std::iota(pairs.estimate_index.begin(), pairs.estimate_index.end(), std::size_t{0});
  pairs.unmatched_truth = truth.poses.size() - n;
  pairs.unmatched_estimate = estimate.poses.size() - n;
}

struct SegmentSum {
  double translation = 0.0;
  double rotation_deg = 0.0;
  std::size_t count = 0;

  [[nodiscard]] SegmentError mean(double length_m) const {
    const auto n = static_cast<double>(count);
    return {length_m, 100.0 * translation / n, 100.0 * rotation_deg / n, count};
  }
};

/// Transform that brings the estimate onto the truth, and whether its rotation is unique.
std::pair<Pose, bool> umeyama(const PosePairs& pairs) {
  const auto n = static_cast<double>(pairs.truth.size());
  Eigen::Vector3d mean_truth = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_estimate = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < pairs.truth.size(); ++i) {
    mean_truth += pairs.truth[i].translation() / n;
    mean_estimate += pairs.estimate[i].translation() / n;
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < pairs.truth.size(); ++i) {
    covariance += (pairs.truth[i].translation() - mean_truth) *
                  (pairs.estimate[i].translation() - mean_estimate).transpose() / n;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d sign = Eigen::Matrix3d::Identity();
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0) sign(2, 2) = -1.0;
  Pose transform = Pose::Identity();
  transform.linear() = svd.matrixU() * sign * svd.matrixV().transpose();
  transform.translation() = mean_truth - transform.linear() * mean_estimate;
  const Eigen::Vector3d& d = svd.singularValues();
  return {transform, d(1) > kMinSpreadRatio * std::max(d(0), 1e-12)};
}

Pose alignment_transform(const PosePairs& pairs, Alignment alignment) {
  switch (alignment) {
    case Alignment::kOrigin:
      return pairs.truth.front() * pairs.estimate.front().inverse();
    case Alignment::kSe3:
      return umeyama(pairs).first;
    case Alignment::kNone:
      break;
  }
  return Pose::Identity();
}

AbsoluteError absolute_error(const PosePairs& pairs, Alignment alignment) {
  const std::vector<Pose> aligned = align(pairs, alignment);
  AbsoluteError error;
  error.alignment = alignment;
  std::vector<double> translation;
  std::vector<double> rotation;
  for (std::size_t i = 0; i < aligned.size(); ++i) {
    error.end_translation_m = (aligned[i].translation() - pairs.truth[i].translation()).norm();
    error.end_rotation_deg = rotation_angle_deg((aligned[i].inverse() * pairs.truth[i]).linear());
    translation.push_back(error.end_translation_m);
    rotation.push_back(error.end_rotation_deg);
  }
  error.errors = {compute_statistics(std::move(translation)), compute_statistics(std::move(rotation))};
  return error;
}

PoseErrors relative_error(const PosePairs& pairs) {
  std::vector<double> translation;
  std::vector<double> rotation;
  for (std::size_t i = 1; i < pairs.truth.size(); ++i) {
    const Pose truth_step = pairs.truth[i - 1].inverse() * pairs.truth[i];
    const Pose estimate_step = pairs.estimate[i - 1].inverse() * pairs.estimate[i];
    const Pose error = truth_step.inverse() * estimate_step;
    translation.push_back(error.translation().norm());
    rotation.push_back(rotation_angle_deg(error.linear()));
  }
  return {compute_statistics(std::move(translation)), compute_statistics(std::move(rotation))};
}

}  // namespace

const char* alignment_name(Alignment alignment) {
  switch (alignment) {
    case Alignment::kOrigin:
      return "origin";
    case Alignment::kSe3:
      return "se3";
    case Alignment::kNone:
      break;
  }
  return "none";
}

double rotation_angle_deg(const Eigen::Matrix3d& rotation) {
  const Eigen::Vector3d axis(rotation(2, 1) - rotation(1, 2), rotation(0, 2) - rotation(2, 0),
                             rotation(1, 0) - rotation(0, 1));
  return kDegreesPerRadian * std::atan2(0.5 * axis.norm(), 0.5 * (rotation.trace() - 1.0));
}

core::Result<PosePairs> associate(const Trajectory& truth, const Trajectory& estimate,
                                  const AssociationOptions& options) {
  if (truth.format != estimate.format) {
    const bool truth_has_time = truth.format == TrajectoryFormat::kTum;
    return core::Error{
        (truth_has_time ? estimate.path : truth.path) + " (KITTI) has no times to be associated with " +
        (truth_has_time ? truth.path : estimate.path) + " (TUM) - give both in the same format"};
  }
  PosePairs pairs;
  if (truth.format == TrajectoryFormat::kKitti) {
    associate_by_index(truth, estimate, pairs);
  } else if (options.method == Association::kNearest) {
    associate_nearest(truth, estimate, options.max_time_difference.value_or(kDefaultMaxDifference), pairs);
  } else {
    associate_interpolated(truth, estimate, options.max_time_difference.value_or(kDefaultMaxGap), pairs);
  }
  if (pairs.truth.size() >= 2) return pairs;
  const std::string count =
      std::to_string(pairs.truth.size()) + " poses could be associated, two are needed: ";
  if (truth.format == TrajectoryFormat::kKitti) {
    return core::Error{count + truth.path + " has " + std::to_string(truth.poses.size()) + " poses, " +
                       estimate.path + " has " + std::to_string(estimate.poses.size())};
  }
  return core::Error{count + time_range(truth) + "; " + time_range(estimate) +
                     " - check that both use the same clock, or raise --max-time-difference"};
}

Statistics compute_statistics(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  Statistics statistics;
  statistics.mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double squares = 0.0;
  double deviations = 0.0;
  for (const double value : values) {
    squares += value * value;
    deviations += (value - statistics.mean) * (value - statistics.mean);
  }
  statistics.rmse = std::sqrt(squares / n);
  statistics.std = std::sqrt(deviations / n);
  const std::size_t middle = values.size() / 2;
  statistics.median = values.size() % 2 == 1 ? values[middle] : 0.5 * (values[middle - 1] + values[middle]);
  statistics.min = values.front();
  statistics.max = values.back();
  return statistics;
}

std::vector<Pose> align(const PosePairs& pairs, Alignment alignment) {
  const Pose transform = alignment_transform(pairs, alignment);
  std::vector<Pose> aligned;
  aligned.reserve(pairs.estimate.size());
  for (const Pose& pose : pairs.estimate) aligned.push_back(transform * pose);
  return aligned;
}

std::optional<SegmentErrors> segment_errors(const PosePairs& pairs, std::span<const double> lengths_m,
                                            std::size_t step) {
  const std::vector<double> distance = path_lengths(pairs.truth);
  std::vector<SegmentSum> sums(lengths_m.size());
  SegmentSum total;
  for (std::size_t first = 0; first < pairs.truth.size(); first += step) {
    for (std::size_t k = 0; k < lengths_m.size(); ++k) {
      const auto end = std::upper_bound(distance.begin(), distance.end(), distance[first] + lengths_m[k]);
      if (end == distance.end()) continue;
      const auto last = static_cast<std::size_t>(end - distance.begin());
      const Pose truth_step = pairs.truth[first].inverse() * pairs.truth[last];
      const Pose estimate_step = pairs.estimate[first].inverse() * pairs.estimate[last];
      const Pose error = estimate_step.inverse() * truth_step;
      const double translation = error.translation().norm() / lengths_m[k];
      const double rotation_deg = rotation_angle_deg(error.linear()) / lengths_m[k];
      for (SegmentSum* sum : {&sums[k], &total}) {
        sum->translation += translation;
        sum->rotation_deg += rotation_deg;
        ++sum->count;
      }
    }
  }
  if (total.count == 0) return std::nullopt;
  SegmentErrors errors{total.mean(0.0), {}};
  for (std::size_t k = 0; k < lengths_m.size(); ++k) {
    if (sums[k].count > 0) errors.per_length.push_back(sums[k].mean(lengths_m[k]));
  }
  return errors;
}

Evaluation evaluate(const PosePairs& pairs, const EvaluationOptions& options) {
  Evaluation evaluation;
  evaluation.associated = pairs.truth.size();
  evaluation.unmatched_truth = pairs.unmatched_truth;
  evaluation.unmatched_estimate = pairs.unmatched_estimate;
  evaluation.truth_length_m = path_length(pairs.truth);
  evaluation.estimate_length_m = path_length(pairs.estimate);
  if (options.report_unaligned) evaluation.absolute.push_back(absolute_error(pairs, Alignment::kNone));
  evaluation.absolute.push_back(absolute_error(pairs, Alignment::kOrigin));
  evaluation.absolute.push_back(absolute_error(pairs, Alignment::kSe3));
  evaluation.alignment_degenerate = !umeyama(pairs).second;
  evaluation.relative = relative_error(pairs);
  evaluation.segments = segment_errors(pairs, options.segment_lengths_m, 10);
  evaluation.short_segments = segment_errors(pairs, options.short_segment_lengths_m, 5);
  return evaluation;
}

}  // namespace nilio::tools::evaluate
