#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <cstddef>
#include <optional>
#include <vector>

namespace nilio::core {

/// Inertial measurement in base_link axes.
struct BaseImuSample {
  Time stamp;
  Vector3 angular_velocity = Vector3::Zero();
  Vector3 linear_acceleration = Vector3::Zero();
};

/// Ring of the last samples of one IMU, in order of time. Fixed capacity: the oldest is overwritten.
class ImuBuffer {
 public:
  explicit ImuBuffer(std::size_t capacity);

  /// Returns false and stores nothing for a stamp that does not advance or a value that is not finite.
  bool add(const ImuSample& sample, const Eigen::Quaterniond& R_base_imu);
  void clear() { size_ = 0; }
  /// Moves the stamps of all samples, where the offset between two clocks is known better.
  void move_stamps(Duration by);

  [[nodiscard]] std::size_t size() const { return size_; }
  /// 0 = oldest.
  [[nodiscard]] const BaseImuSample& operator[](std::size_t i) const {
    return samples_[(first_ + i) % samples_.size()];
  }
  [[nodiscard]] std::optional<Time> latest() const;
  /// First sample not before `time`; size() when there is none.
  [[nodiscard]] std::size_t lower_bound(Time time) const;
  /// True when samples bracket [from, to] and no two neighbours in between are farther apart than `max_gap`.
  [[nodiscard]] bool covers(Time from, Time to, Duration max_gap) const;
  /// Angular velocity at `time`, linear between the neighbours, constant beyond the ends. Needs size() > 0.
  [[nodiscard]] Vector3 angular_velocity_at(Time time) const {
    return value_at(&BaseImuSample::angular_velocity, time);
  }
  /// Specific force, likewise.
  [[nodiscard]] Vector3 specific_force_at(Time time) const {
    return value_at(&BaseImuSample::linear_acceleration, time);
  }

 private:
  [[nodiscard]] Vector3 value_at(Vector3 BaseImuSample::*member, Time time) const;

  std::vector<BaseImuSample> samples_;
  std::size_t first_ = 0;
  std::size_t size_ = 0;
};

/// Means over [from, to] with linear interpolation between samples; the buffer must cover the span, which
/// must not be empty.
Vector3 mean_angular_velocity(const ImuBuffer& buffer, Time from, Time to);
Vector3 mean_specific_force(const ImuBuffer& buffer, Time from, Time to);

/// Mean and spread of the samples in [from, to].
struct ImuStatistics {
  std::size_t count = 0;
  Vector3 mean_angular_velocity = Vector3::Zero();
  Vector3 mean_acceleration = Vector3::Zero();
  /// Root mean square of the deviations from the means.
  double angular_velocity_deviation = 0.0;
  double acceleration_deviation = 0.0;
};
ImuStatistics imu_statistics(const ImuBuffer& buffer, Time from, Time to);

}  // namespace nilio::core
