#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tools/simulate/faults/imu_faults.hpp"
#include "tools/simulate/sensors/lidar_model.hpp"
#include "tools/simulate/sensors/position_model.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <functional>
#include <string>

namespace nilio::tools::simulate {

struct LidarRecordingSummary {
  std::uint64_t packets = 0;
  std::uint64_t position_packets = 0;
  std::uint64_t firings = 0;
  /// Firings with a return.
  std::uint64_t returns = 0;
  /// Wall time of casting and writing.
  double elapsed_s = 0.0;
};

/// Each writes one file of a recording and replaces an existing one. Errors name the file. `positions` may be
/// null.
core::Result<LidarRecordingSummary> write_lidar_recording(const LidarModel& model,
                                                          const PositionModel* positions,
                                                          const std::string& path);
/// `next_sample` is called `count` times.
core::Result<std::uint64_t> write_imu_recording(const std::function<core::ImuSample()>& next_sample,
                                                std::uint64_t count, ImuFaults faults,
                                                const drivers::ImuPreset& preset, const std::string& path);
/// T_truth_base every 5 ms as a TUM file.
core::Result<std::uint64_t> write_truth(const VehicleTrajectory& trajectory, const core::SE3& T_truth_world,
                                        core::Time start, const std::string& path);

/// Mounting of a sensor on the vehicle as in configuration files: R = Rz(yaw) Ry(pitch) Rx(roll).
struct Mounting {
  core::Vector3 translation_m = core::Vector3::Zero();
  core::Vector3 rotation_rpy_deg = core::Vector3::Zero();

  [[nodiscard]] core::SE3 T_base_sensor() const;
};

/// The sensors of a recording.
struct RecordedSensors {
  std::string lidar_model;
  /// Empty = the model's built-in geometry.
  std::string calibration_file;
  Mounting lidar;
  /// Empty = no IMU.
  std::string imu_preset;
  Mounting imu;
};

/// Writes the configuration of niliod for the recording.
core::Result<bool> write_configuration(const RecordedSensors& sensors, const std::string& path);

}  // namespace nilio::tools::simulate
