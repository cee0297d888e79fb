#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/imu_decoder.hpp"

#include "simulation/imu_faults.hpp"
#include "simulation/imu_model.hpp"
#include "simulation/lidar_model.hpp"
#include "simulation/vehicle_trajectory.hpp"

#include <cstdint>
#include <string>

namespace nilio::tools::simulation {

struct LidarRecordingSummary {
  std::uint64_t packets = 0;
  std::uint64_t firings = 0;
  std::uint64_t returns = 0;
  /// Wall time of casting and writing.
  double elapsed_s = 0.0;
};

/// Each writes one file of a recording, replacing it. Errors name the file and what to do.
core::Result<LidarRecordingSummary> write_lidar_recording(const LidarModel& model, const std::string& path);
core::Result<std::uint64_t> write_imu_recording(ImuModel model, ImuFaults faults,
                                                const drivers::ImuPreset& preset, const std::string& path);
/// T_world_base every 5 ms as a TUM file; world is the first pose.
core::Result<std::uint64_t> write_truth(const VehicleTrajectory& trajectory, core::Time start,
                                        const std::string& path);

/// A sensor's place on the vehicle as configuration files have it: R = Rz(yaw) Ry(pitch) Rx(roll).
struct Mounting {
  core::Vector3 translation_m = core::Vector3::Zero();
  core::Vector3 rotation_rpy_deg = core::Vector3::Zero();

  [[nodiscard]] core::SE3 T_base_sensor() const;
};

/// What niliod needs to know about the recording; `imu_preset` empty = no IMU.
core::Result<bool> write_configuration(std::string_view lidar_model, const Mounting& lidar,
                                       const std::string& imu_preset, const Mounting& imu,
                                       const std::string& path);

}  // namespace nilio::tools::simulation
