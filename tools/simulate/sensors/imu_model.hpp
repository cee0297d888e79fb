#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>

namespace nilio::tools::simulate {

/// m/s^2, along -z of world.
inline constexpr double kGravity = 9.81;

/// Errors of the three axes of an inertial sensor, in its unit (rad/s or m/s^2).
struct ImuErrors {
  double noise_density = 0.0;  ///< unit / sqrt(Hz), one-sided
  double constant_bias = 0.0;  ///< magnitude of each axis's bias; random signs
  double drift = 0.0;          ///< standard deviation of the in-run bias
  double scale = 0.0;          ///< relative scale error of each axis; random signs
};

struct ImuModelConfig {
  std::uint64_t seed = 1;
  /// Time of the trajectory's time 0.
  core::Time start;
  core::SE3 T_base_imu;
  double rate_hz = 200.0;
  ImuErrors gyroscope;
  ImuErrors accelerometer;
};

/// Error model of a MEMS IMU: white noise, a constant turn-on bias, an in-run bias as first-order
/// Gauss-Markov process with a time constant of 300 s (IEEE Std 952), and a scale error.
class ImuErrorProcess {
 public:
  ImuErrorProcess(const ImuErrors& errors, double rate_hz, RandomStream random);
  /// Next sample for the true value `truth`.
  core::Vector3 next(const core::Vector3& truth);

 private:
  ImuErrors errors_;
  double noise_per_sample_;
  double decay_;
  RandomStream random_;
  core::Vector3 constant_;
  core::Vector3 in_run_;
  core::Vector3 scale_;
};

/// Measurement of an ideal inertial sensor in its own axes.
struct TrueInertia {
  core::Vector3 angular_velocity;  ///< rad/s
  core::Vector3 specific_force;    ///< m/s^2, +9.81 on z when level and at rest
};
TrueInertia true_inertia(const VehicleTrajectory& trajectory, const core::SE3& T_base_imu, double time_s);

/// IMU on the moving vehicle: specific force and angular rate at its own place and in its own axes. Samples
/// come in order; one thread.
class ImuModel {
 public:
  ImuModel(const ImuModelConfig& config, const VehicleTrajectory& trajectory);

  /// Samples within the drive.
  [[nodiscard]] std::uint64_t sample_count() const { return sample_count_; }
  core::ImuSample next();

 private:
  ImuModelConfig config_;
  const VehicleTrajectory& trajectory_;
  ImuErrorProcess gyroscope_;
  ImuErrorProcess accelerometer_;
  std::uint64_t sample_count_;
  std::uint64_t index_ = 0;
};

}  // namespace nilio::tools::simulate
