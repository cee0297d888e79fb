#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne_model.hpp"
#include "nilio/drivers/velodyne_packet.hpp"

#include "simulation/ray_scene.hpp"
#include "simulation/vehicle_trajectory.hpp"

#include <array>
#include <cstdint>

namespace nilio::tools::simulation {

struct LidarModelConfig {
  std::uint64_t seed = 1;
  /// Instant of the trajectory's time 0.
  core::Time start;
  core::SE3 T_base_lidar;
  double revolutions_per_minute = 600.0;
  /// One standard deviation.
  double range_noise_m = 0.02;
};

struct SimulatedPacket {
  /// When a host would receive it.
  core::Time stamp;
  std::array<std::uint8_t, drivers::kDataPacketSize> payload{};
  std::uint32_t returns = 0;
};

/// A Velodyne sensor on a moving vehicle: each firing is cast at its own time, from where the sensor is then,
/// along the beam that the decoder will reconstruct from the packet (with its rounding of azimuths and
/// times), through the inverse of the sensor's calibration. Ranges get noise and the packet's resolution;
/// weak echoes (dark, grazing or far surfaces) get lost. Packets depend on nothing but the configuration and
/// their index, so they may be made by any number of threads in any order. The references must outlive the
/// model.
class LidarModel {
 public:
  LidarModel(drivers::VelodyneSensor sensor, const LidarModelConfig& config,
             const VehicleTrajectory& trajectory, const RayScene& scene);

  /// Packets whose last firing is within the drive.
  [[nodiscard]] std::uint64_t packet_count() const { return packet_count_; }
  [[nodiscard]] SimulatedPacket make_packet(std::uint64_t index) const;

 private:
  /// A beam in the sensor's frame while the azimuth is 0: origin + distance * direction, distance as
  /// calibrated.
  struct Beam {
    core::Vector3 origin;
    core::Vector3 direction;
  };
  struct Motion;

  [[nodiscard]] Motion motion_during(double packet_time_s) const;
  [[nodiscard]] std::uint16_t block_azimuth(double time_s) const;
  void cast_block(const Motion& motion, std::uint64_t index, std::size_t block,
                  drivers::VelodyneDataPacket& packet) const;
  [[nodiscard]] drivers::VelodyneDataPacket::Entry measure(const RayHit& hit, double distance_correction_m,
                                                           std::uint64_t packet_index,
                                                           std::uint64_t firing) const;

  drivers::VelodyneSensor sensor_;
  LidarModelConfig config_;
  const VehicleTrajectory& trajectory_;
  const RayScene& scene_;
  std::vector<Beam> beams_;
  /// Steps in which azimuths are reported, 0.01 degree.
  int azimuth_step_ = 1;
  double max_range_m_ = 100.0;
  /// How far a surface of 10 % reflectivity is seen.
  double dark_range_m_ = 50.0;
  double duration_of_packet_s_ = 0.0;
  std::uint64_t packet_count_ = 0;
};

}  // namespace nilio::tools::simulation
