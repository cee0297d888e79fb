#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/simulate/sensors/sensor_timing.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <array>
#include <cstdint>
#include <string>

namespace nilio::tools::simulate {

/// Data packets per position packet (manual 63-9325).
inline constexpr std::uint64_t kDataPacketsPerPosition = 14;

struct SimulatedPosition {
  /// Host receive time: after data packet 14 * index and before the next.
  core::Time stamp;
  std::array<std::uint8_t, drivers::kPositionPacketSize> payload{};
};

/// The sensor's telemetry: state of its clock, temperatures, the GPS sentence, and an HDL-32E's gyros and
/// accelerometers. Packets depend only on their index. The references must outlive the model.
class PositionModel {
 public:
  PositionModel(drivers::VelodyneModel model, GpsReception gps, const core::SE3& T_base_lidar,
                const SensorTiming& timing, const VehicleTrajectory& trajectory);

  [[nodiscard]] SimulatedPosition make_packet(std::uint64_t index) const;

 private:
  [[nodiscard]] std::string sentence(core::Duration time) const;
  [[nodiscard]] std::array<drivers::Hdl32eBoard, 3> boards(core::Duration time) const;

  drivers::VelodyneModel model_;
  GpsReception gps_;
  core::SE3 T_base_lidar_;
  const SensorTiming& timing_;
  const VehicleTrajectory& trajectory_;
};

/// True for all models except the HDL-64E, which has a status stream instead.
bool sends_position_packets(drivers::VelodyneModel model);

/// An RMC sentence with checksum and line end.
struct RmcFields {
  core::Time utc;
  double latitude_deg = 0.0;
  double longitude_deg = 0.0;
  double speed_m_s = 0.0;
  /// Clockwise from north.
  double course_deg = 0.0;
};
std::string format_rmc(const RmcFields& fields);

}  // namespace nilio::tools::simulate
