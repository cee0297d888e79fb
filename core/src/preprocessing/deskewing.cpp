#include "core/src/preprocessing/deskewing.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

// Maximum step of the gyro integration.
constexpr double kMaxStepSeconds = 0.005;

/// Time of node i since the previous pose: node 0 is the previous pose, the others are the cell borders.
double node_time(const MotionModel::Span& span, std::size_t i) {
  if (i == 0) return 0.0;
  const double start = std::max(0.0, (span.start - span.previous).seconds());
  const double end = (span.end - span.previous).seconds();
  return start + (end - start) * static_cast<double>(i - 1) / static_cast<double>(kSweepCells);
}

}  // namespace

void MotionModel::set_rotation_from_imu(const Span& span, const ImuBuffer& imu, const Vector3& gyro_bias) {
  follows_gyro_ = true;
  sweep_s_ = (span.end - span.start).seconds();
  rotation_correction_.setZero();
  nodes_[0] = {};
  for (std::size_t i = 1; i < nodes_.size(); ++i) {
    const double begin = nodes_[i - 1].time_s;
    const double end = node_time(span, i);
    const int steps = std::max(1, static_cast<int>((end - begin) / kMaxStepSeconds) + 1);
    const double step = (end - begin) / steps;
    Eigen::Quaterniond rotation = nodes_[i - 1].rotation;
    for (int k = 0; k < steps; ++k) {
      const Time middle = span.previous + Duration::from_seconds(begin + (k + 0.5) * step);
      rotation = (rotation * so3_exp((imu.angular_velocity_at(middle) - gyro_bias) * step)).normalized();
    }
    nodes_[i] = {rotation, end};
  }
}

void MotionModel::set_constant_rotation(const Span& span, const Vector3& angular_velocity) {
  follows_gyro_ = false;
  sweep_s_ = (span.end - span.start).seconds();
  rotation_correction_.setZero();
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const double time_s = node_time(span, i);
    nodes_[i] = {so3_exp(angular_velocity * time_s), time_s};
  }
}

Eigen::Quaterniond MotionModel::corrected_rotation(const Node& node) const {
  const double share = duration_s() > 0.0 ? node.time_s / duration_s() : 0.0;
  return node.rotation * so3_exp(rotation_correction_ * share);
}

Matrix3 MotionModel::rotation_integral(std::size_t first_node) const {
  Matrix3 integral = Matrix3::Zero();
  for (std::size_t i = first_node + 1; i < nodes_.size(); ++i) {
    const double step = nodes_[i].time_s - nodes_[i - 1].time_s;
    integral +=
        so3_mean(corrected_rotation(nodes_[i - 1]), corrected_rotation(nodes_[i])).toRotationMatrix() * step;
  }
  return integral;
}

SE3 MotionModel::predict(const Vector3& body_velocity) {
  rotation_correction_.setZero();
  body_velocity_ = body_velocity;
  build_cells();
  return {nodes_.back().rotation, rotation_integral() * body_velocity};
}

SE3 MotionModel::T_middle_end() const {
  constexpr std::size_t middle = 1 + kSweepCells / 2;
  const Eigen::Quaterniond R_middle_previous = corrected_rotation(nodes_[middle]).conjugate();
  return {R_middle_previous * corrected_rotation(nodes_.back()),
          R_middle_previous * (rotation_integral(middle) * body_velocity_)};
}

Vector6 MotionModel::measure(const SE3& T_previous_end, const SE3& previous_T_middle_end,
                             double previous_sweep_s) const {
  const double seconds = between_s(previous_sweep_s);
  if (seconds <= 0.0) return Vector6::Zero();
  return se3_log(previous_T_middle_end * T_previous_end * T_middle_end().inverse()) / seconds;
}

SE3 MotionModel::refine(const SE3& T_previous_end, const Vector6& twist) {
  const SE3 T_previous_middle = T_previous_end * T_middle_end().inverse();
  if (!follows_gyro_) rotation_correction_ = twist.tail<3>() * duration_s() - so3_log(nodes_.back().rotation);
  body_velocity_ = twist.head<3>();
  build_cells();
  return T_previous_middle * T_middle_end();
}

Vector3 MotionModel::mean_angular_velocity() const {
  if (duration_s() <= 0.0) return Vector3::Zero();
  return so3_log(corrected_rotation(nodes_.back())) / duration_s();
}

void MotionModel::build_cells() {
  // Walk backwards from the end: T_end_t of each border, then of the middles.
  const Eigen::Quaterniond R_end_previous = corrected_rotation(nodes_.back()).conjugate();
  SE3 T_end_border;
  for (std::size_t i = nodes_.size() - 1; i >= 2; --i) {
    const double step = nodes_[i].time_s - nodes_[i - 1].time_s;
    const Eigen::Quaterniond before = R_end_previous * corrected_rotation(nodes_[i - 1]);
    const Eigen::Quaterniond middle = so3_mean(before, T_end_border.rotation);
    const Vector3 half_way = middle * body_velocity_ * (0.5 * step);
    const Vector3 rate =
        step > 0.0 ? Vector3(so3_log(before.conjugate() * T_end_border.rotation) / step) : Vector3::Zero();
    Cell& cell = cells_[i - 2];
    cell.rotation = middle.toRotationMatrix().cast<float>();
    cell.translation = (T_end_border.translation - half_way).cast<float>();
    cell.angular_velocity = rate.cast<float>();
    cell.velocity = body_velocity_.cast<float>();
    T_end_border = {before, T_end_border.translation - 2.0 * half_way};
  }
}

void MotionModel::deskew(const std::vector<SweepPoint>& points, std::vector<Eigen::Vector3f>& output) const {
  output.resize(points.size());
  const auto sweep = static_cast<float>(sweep_s_);
  const float cells_per_second = sweep > 0.0F ? static_cast<float>(kSweepCells) / sweep : 0.0F;
  const float cell_s = sweep / static_cast<float>(kSweepCells);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i].position;
    const float since_start = points[i].time_s + sweep;
    const auto index = static_cast<std::size_t>(
        std::clamp(since_start * cells_per_second, 0.0F, static_cast<float>(kSweepCells - 1)));
    const Cell& cell = cells_[index];
    const float offset = since_start - (static_cast<float>(index) + 0.5F) * cell_s;
    output[i] =
        cell.rotation * (p + offset * (cell.velocity + cell.angular_velocity.cross(p))) + cell.translation;
  }
}

}  // namespace nilio::core
