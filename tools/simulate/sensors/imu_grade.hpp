#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/sensors/imu_model.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// Class of an IMU, by the parts of data sheets: phone, chassis sensor, MEMS module, tactical MEMS.
enum class ImuGrade : std::uint8_t { kConsumer, kAutomotive, kIndustrial, kTactical };
const std::vector<std::string>& imu_grade_names();

/// Errors of one kind of inertial sensor, one standard deviation for each unit and axis, in its unit (rad/s
/// or m/s^2).
struct InertialErrors {
  double noise_density = 0.0;  ///< unit / sqrt(Hz)
  double in_run = 0.0;         ///< standard deviation of the in-run bias, a first-order Gauss-Markov process
  double walk = 0.0;           ///< random walk of the bias, unit / sqrt(s)
  double start_bias = 0.0;
  double per_kelvin = 0.0;
  double per_g = 0.0;       ///< gyroscope: rad/s for each m/s^2
  double scale = 0.0;       ///< relative
  double axes_rad = 0.0;    ///< non-orthogonality
  double step = 0.0;        ///< quantisation; 0 = none
  double full_scale = 0.0;  ///< 0 = unlimited
};

struct ImuGradeModel {
  InertialErrors gyroscope;
  InertialErrors accelerometer;
  double correlation_s = 300.0;
  double package_rad = 0.0;  ///< mounting of the axes in the package
  double bandwidth_hz = 50.0;
  double delay_s = 0.0;  ///< from measurement to the CAN frame
};
/// Allan parameters of data sheets and papers; docs/results/realism.md names the parts.
ImuGradeModel model_of(ImuGrade grade);

/// One unit of a grade on the moving vehicle. The true motion is low-pass filtered at the unit's bandwidth
/// (two poles) at a rate of at least 1 kHz before it is sampled, as in the sensor; the stamps are those of
/// the CAN frames, late by the delay. The temperature rises by 15 K with a time constant of 10 min. Samples
/// come in order; one thread.
class GradedImu {
 public:
  GradedImu(ImuGrade grade, const ImuModelConfig& config, const VehicleTrajectory& trajectory);
  [[nodiscard]] std::uint64_t sample_count() const { return sample_count_; }
  core::ImuSample next();

 private:
  /// Two cascaded first-order low-passes for six values.
  using Six = Eigen::Matrix<double, 6, 1>;
  struct Axis3 {
    core::Matrix3 distortion = core::Matrix3::Identity();
    core::Vector3 bias = core::Vector3::Zero();
    core::Vector3 in_run = core::Vector3::Zero();
    core::Vector3 walked = core::Vector3::Zero();
    core::Vector3 per_kelvin = core::Vector3::Zero();
    core::Matrix3 per_g = core::Matrix3::Zero();
  };
  Axis3 draw(const InertialErrors& errors, RandomStream& random) const;
  core::Vector3 measure(const InertialErrors& errors, Axis3& unit, const core::Vector3& truth,
                        const core::Vector3& force, double kelvin, RandomStream& random) const;
  void filter_until(double time_s);

  ImuGradeModel model_;
  ImuModelConfig config_;
  const VehicleTrajectory& trajectory_;
  RandomStream gyro_random_;
  RandomStream accel_random_;
  Axis3 gyroscope_;
  Axis3 accelerometer_;
  std::uint64_t steps_per_sample_;
  std::uint64_t step_ = 0;
  double step_s_;
  double gain_;
  Six first_ = Six::Zero();
  Six second_ = Six::Zero();
  std::uint64_t sample_count_;
  std::uint64_t index_ = 0;
};

}  // namespace nilio::tools::simulate
