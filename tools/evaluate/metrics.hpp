#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/trajectory.hpp"

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::evaluate {

/// Association of the poses of two TUM files. KITTI files are paired line by line.
enum class Association {
  kInterpolate,  ///< truth interpolated at the estimate's stamps
  kNearest,      ///< as evo: each pose of the shorter trajectory with the nearest of the longer
};

/// Alignment of the estimate before absolute errors are computed.
enum class Alignment {
  kNone,
  kOrigin,  ///< first associated poses made equal
  kSe3,     ///< least squares over the positions without scale (Umeyama 1991)
};

struct AssociationOptions {
  Association method = Association::kInterpolate;
  /// kInterpolate: largest distance of the truth's neighbours, default 0.2 s. kNearest: largest difference of
  /// the stamps, default 0.01 s as in evo.
  std::optional<core::Duration> max_time_difference;
};

/// Poses of both trajectories at the same instants, in order of time.
struct PosePairs {
  std::vector<Pose> truth;
  std::vector<Pose> estimate;
  std::vector<std::size_t> estimate_index;  ///< place of each associated pose in the estimate's trajectory
  std::size_t unmatched_truth = 0;
  std::size_t unmatched_estimate = 0;
};

/// Fails when the formats differ or fewer than two poses are associated; the message has both time ranges.
core::Result<PosePairs> associate(const Trajectory& truth, const Trajectory& estimate,
                                  const AssociationOptions& options);

/// evo's definitions; std is that of the population.
struct Statistics {
  double rmse = 0.0;
  double mean = 0.0;
  double median = 0.0;
  double std = 0.0;
  double min = 0.0;
  double max = 0.0;
};

/// All zero for no values.
Statistics compute_statistics(std::vector<double> values);

struct PoseErrors {
  Statistics translation_m;
  Statistics rotation_deg;
};

/// Absolute pose error with one alignment.
struct AbsoluteError {
  Alignment alignment = Alignment::kOrigin;
  PoseErrors errors;
  /// Distance and angle between the last poses.
  double end_translation_m = 0.0;
  double end_rotation_deg = 0.0;
};

struct SegmentError {
  double length_m = 0.0;
  double translation_percent = 0.0;
  double rotation_deg_per_100m = 0.0;
  std::size_t count = 0;
};

/// Mean over all segments of all lengths, and per length (only lengths that occur).
struct SegmentErrors {
  SegmentError all;
  std::vector<SegmentError> per_length;
};

struct Evaluation {
  std::size_t associated = 0;
  std::size_t unmatched_truth = 0;
  std::size_t unmatched_estimate = 0;
  double truth_length_m = 0.0;
  double estimate_length_m = 0.0;
  /// kOrigin, kSe3 and, on request, kNone.
  std::vector<AbsoluteError> absolute;
  /// The positions lie nearly on one line or in one point, so that the rotation of the SE(3) alignment is
  /// arbitrary.
  bool alignment_degenerate = false;
  /// Between consecutive pairs.
  PoseErrors relative;
  /// Empty when the path is shorter than the shortest segment.
  std::optional<SegmentErrors> segments;
  std::optional<SegmentErrors> short_segments;
};

struct EvaluationOptions {
  bool report_unaligned = false;
  /// Lengths of the KITTI odometry benchmark, metres; a segment begins at every tenth pose.
  std::vector<double> segment_lengths_m{100, 200, 300, 400, 500, 600, 700, 800};
  /// For paths shorter than that; a segment begins at every fifth pose.
  std::vector<double> short_segment_lengths_m{10, 20, 30, 40, 50, 60, 70, 80};
};

/// `pairs` as associate() returns them, two or more.
Evaluation evaluate(const PosePairs& pairs, const EvaluationOptions& options);

/// Poses of the estimate, transformed by the alignment.
std::vector<Pose> align(const PosePairs& pairs, Alignment alignment);

/// Devkit of the KITTI odometry benchmark (Geiger et al., CVPR 2012): relative pose error over segments of
/// the truth's path that begin at every `step`-th pose, divided by their nominal length.
std::optional<SegmentErrors> segment_errors(const PosePairs& pairs, std::span<const double> lengths_m,
                                            std::size_t step);

/// Angle of a rotation, degrees, 0..180; exact also for small angles.
double rotation_angle_deg(const Eigen::Matrix3d& rotation);

const char* alignment_name(Alignment alignment);

/// Choices of the user.
struct ReportOptions {
  /// Alignment for the end drift.
  Alignment alignment = Alignment::kOrigin;
};

/// Distance between the last poses under the chosen alignment in percent of the truth's path; 0 for a truth
/// at rest.
double end_drift_percent(const Evaluation& evaluation, Alignment alignment);

/// The row of `evaluation.absolute` with this alignment; the evaluation must have it.
const AbsoluteError& absolute_error_of(const Evaluation& evaluation, Alignment alignment);

/// Tables for a terminal.
std::string format_report(const Evaluation& evaluation, const ReportOptions& options);

/// The same numbers in full precision; keys contain the units.
std::string format_json(const Evaluation& evaluation, const ReportOptions& options);

}  // namespace nilio::tools::evaluate
