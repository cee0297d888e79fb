#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/model.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/simulate/geometry/surface.hpp"
#include "tools/simulate/sensors/echo.hpp"
#include "tools/simulate/sensors/lidar_beam.hpp"
#include "tools/simulate/sensors/lidar_errors.hpp"
#include "tools/simulate/sensors/optics.hpp"
#include "tools/simulate/sensors/weather.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace nilio::tools::simulate {

/// Echoes of one shot, and their entries in the packet.
struct Returns {
  static constexpr std::size_t kCapacity = 8;
  std::array<Echo, kCapacity> echoes;
  std::array<drivers::VelodyneDataPacket::Entry, kCapacity> entries;
  std::size_t count = 0;
};

/// A surface in a part of a shot's footprint.
struct PartialHit {
  RayHit hit;
  /// Share of the light, 0 to 1.
  double share = 1.0;
};

/// A shot as the receiver knows it.
struct ReceivedShot {
  /// Nominal beam, with which receivers decode.
  const LidarBeam* nominal = nullptr;
  std::size_t laser = 0;
  BeamAzimuth azimuth;
  core::Duration time;
  /// Random word of the shot.
  std::uint64_t word = 0;
  /// Share of the light that passes dirt on the window, 0 to 1.
  double transmission = 1.0;
};

/// Receiver of a real unit: light of all parts of the footprint merges to echoes, which are detected at
/// random, biased and noisy. Immutable.
class Receiver {
 public:
  /// `range_noise_m`: noise without Effect::kNoise.
  Receiver(const drivers::VelodyneSensor& sensor, LidarErrors errors, const Weather& weather,
           double range_noise_m);

  [[nodiscard]] Returns receive(std::span<const PartialHit> parts, const ReceivedShot& shot) const;
  [[nodiscard]] const LidarErrors& errors() const { return errors_; }

 private:
  struct Light;
  /// Echo at a range of a given reflectance and incidence, if it is detected.
  void detect(const Light& light, const ReceivedShot& shot, std::uint64_t word, Returns& returns) const;
  void add_entry(double range_m, const Light& light, double signal, const ReceivedShot& shot,
                 std::uint64_t word, Returns& returns) const;
  [[nodiscard]] std::uint8_t intensity(double reflectance, const ReceivedShot& shot, double raw,
                                       std::uint64_t word) const;

  LidarErrors errors_;
  Weather weather_;
  Optics optics_;
  double resolution_m_;
  double range_noise_m_;
  bool reports_reflectivity_;
};

}  // namespace nilio::tools::simulate
