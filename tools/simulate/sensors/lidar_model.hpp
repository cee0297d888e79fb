#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/model.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/simulate/geometry/ray_scene.hpp"
#include "tools/simulate/sensors/echo.hpp"
#include "tools/simulate/sensors/hdl64e_stream.hpp"
#include "tools/simulate/sensors/lidar_beam.hpp"
#include "tools/simulate/sensors/optics.hpp"
#include "tools/simulate/sensors/receiver.hpp"
#include "tools/simulate/sensors/sensor_timing.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::tools::simulate {

struct LidarModelConfig {
  std::uint64_t seed = 1;
  /// Time of the trajectory's time 0; whole microseconds.
  core::Time start;
  core::SE3 T_base_lidar;
  double revolutions_per_minute = 600.0;
  /// Standard deviation.
  double range_noise_m = 0.02;
  drivers::ReturnMode return_mode = drivers::ReturnMode::kSingle;
  GpsReception gps = GpsReception::kLocked;
  /// See SensorTimingConfig.
  core::Duration clock_offset;
  double clock_drift_ppm = 0.0;
  core::Duration network_jitter;
  /// HDL-64E from S2 on: its status stream, with its sensor's lasers if it sends a calibration. Unset = clock
  /// and health only.
  std::optional<Hdl64eStream> stream;
  Realism realism = Realism::kIdeal;
  Effects effects;
  Weather weather;
  /// Sector straight ahead of which dirt lets 2 % of the light through, degrees; 0 = clean.
  double dirt_deg = 0.0;

  /// Whether something other than the effects departs from the ideal.
  [[nodiscard]] bool is_real() const {
    return dirt_deg > 0.0 || weather.attenuation > 0.0 || weather.ground_reflectivity < 1.0;
  }
};

struct SimulatedPacket {
  /// Host receive time.
  core::Time stamp;
  std::array<std::uint8_t, drivers::kDataPacketSize> payload{};
  /// Firings with a return.
  std::uint32_t returns = 0;
};

/// A Velodyne sensor on a moving vehicle. Each firing is cast at its own time and from the sensor's place at
/// that time, along the beam that the decoder reconstructs from the packet (with its rounding of azimuths and
/// times), through the inverse of the sensor's calibration. Ranges get noise and the packet's resolution;
/// weak echoes (dark, grazing or far surfaces) are lost. For two returns the beam's edge is cast too. With
/// effects, shots are cast with the unit's own laser table, and the whole footprint where it is not on one
/// surface. Packets
/// depend only on the configuration and their index, so that any number of threads may make them in any
/// order. The references must outlive the model.
class LidarModel {
 public:
  /// Throws std::invalid_argument for a return mode that the sensor does not have.
  LidarModel(drivers::VelodyneSensor sensor, const LidarModelConfig& config,
             const VehicleTrajectory& trajectory, const RayScene& scene);

  /// Packets whose last firing is within the drive.
  [[nodiscard]] std::uint64_t packet_count() const { return packet_count_; }
  [[nodiscard]] SimulatedPacket make_packet(std::uint64_t index) const;

  [[nodiscard]] const drivers::VelodyneSensor& sensor() const { return sensor_; }
  [[nodiscard]] const drivers::PacketLayout& layout() const { return layout_; }
  [[nodiscard]] const SensorTiming& timing() const { return timing_; }

 private:
  struct Motion;
  struct Shots;
  struct Footprints;
  /// Index and azimuth of a step in a packet.
  struct Step {
    std::uint64_t packet = 0;
    std::size_t index = 0;
    std::uint16_t azimuth = 0;
    /// Where the head points when the laser fires, rad: the encoder's resolution hides it from the decoder.
    double actual_azimuth_rad = 0.0;
  };

  [[nodiscard]] Motion motion_during(std::uint64_t packet) const;
  [[nodiscard]] Step step_at(std::uint64_t packet, std::size_t index) const;
  void set_last_bytes(std::uint64_t index, drivers::VelodyneDataPacket& packet) const;
  /// Fills the blocks of a step; the number of its firings with a return.
  std::uint32_t fill_step(const Motion& motion, const Step& step, drivers::VelodyneDataPacket& packet) const;
  /// The same for 16 entries from `first` of a block with the only or the last return.
  std::uint32_t fill_group(const Motion& motion, const Step& step, std::size_t block, std::size_t first,
                           drivers::VelodyneDataPacket& packet) const;
  [[nodiscard]] Shots aim(const Motion& motion, const Step& step, std::size_t block, std::size_t first) const;
  void cast(const Motion& motion, Shots& shots) const;
  [[nodiscard]] Returns echoes_of(const RayHit& middle, const RayHit& edge, const LidarBeam& beam,
                                  BeamAzimuth azimuth, std::uint64_t word) const;
  void measure(const RayHit& hit, double share, const LidarBeam& beam, BeamAzimuth azimuth,
               std::uint64_t word, Returns& found) const;
  /// Casts the rest of the footprint where it differs from its middle.
  void cast_footprints(const Motion& motion, const Shots& shots, std::uint64_t packet,
                       std::size_t first_entry, Footprints& parts) const;
  [[nodiscard]] Returns real_echoes(const Motion& motion, const Shots& shots, Footprints& parts,
                                    std::size_t i, std::uint64_t word) const;
  /// Replaces a hit by that of a retroreflector in whose halo the shot is.
  void add_halo(const Motion& motion, const Shots& shots, std::size_t i, std::uint64_t word,
                PartialHit& middle) const;
  /// Share of the light that passes dirt; unset = the vehicle itself is in the way.
  [[nodiscard]] std::optional<double> transmission(const core::Vector3& direction) const;
  [[nodiscard]] std::size_t block_with(std::size_t like, drivers::BlockContent content) const;

  drivers::VelodyneSensor sensor_;
  LidarModelConfig config_;
  drivers::PacketLayout layout_;
  SensorTiming timing_;
  const VehicleTrajectory& trajectory_;
  const RayScene& scene_;
  Optics optics_;
  /// As decoded, and as cast.
  std::vector<LidarBeam> beams_;
  std::vector<LidarBeam> cast_beams_;
  /// Unset = ideal.
  std::optional<Receiver> receiver_;
  /// Resolution of reported azimuths, 0.01 degree.
  int azimuth_unit_ = 1;
  std::uint64_t packet_count_ = 0;
};

}  // namespace nilio::tools::simulate
