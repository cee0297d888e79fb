#pragma once

#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"

#include "tests/support/drivers_support.hpp"

#include <span>
#include <vector>

namespace nilio::tests {

inline std::vector<drivers::LaserCalibration> some_lasers() {
  std::vector<drivers::LaserCalibration> lasers(drivers::kHdl64eLasers);
  for (std::size_t id = 0; id < lasers.size(); ++id) {
    const auto i = static_cast<double>(id);
    drivers::LaserCalibration& laser = lasers[id];
    laser.elevation_rad = (2.0 - 0.42 * i) * nilio::kRadiansPerDegree;
    laser.azimuth_correction_rad = (-9.0 + 0.29 * i) * nilio::kRadiansPerDegree;
    laser.distance_correction_m = 1.2 + 0.0051 * i;
    laser.near_distance_correction_x_m = 1.21 + 0.005 * i;
    laser.near_distance_correction_y_m = 1.22 + 0.004 * i;
    laser.vertical_offset_m = id < 32 ? 0.2 : 0.12;
    laser.horizontal_offset_m = id % 2 == 0 ? 0.026 : -0.026;
    laser.focal_distance_m = 0.25 + 0.3 * i;
    laser.focal_slope = 0.5 + 0.1 * static_cast<double>(id % 15);
    laser.min_intensity = static_cast<std::uint8_t>(id);
    laser.max_intensity = static_cast<std::uint8_t>(255 - id);
  }
  return lasers;
}

inline drivers::Hdl64eUnit some_unit() {
  drivers::Hdl64eUnit unit;
  unit.upper_threshold = 31;
  unit.lower_threshold = 29;
  unit.calibrated = core::Time{kEpochNs};
  unit.humidity_percent = 40;
  unit.motor_rpm = 600;
  unit.field_of_view_start = 100;
  unit.field_of_view_end = 35'900;
  unit.life_hours = 1234;
  unit.source_address = 0xC0A802C8;
  unit.destination_address = 0xC0A80203;
  unit.returns = drivers::Hdl64eReturn::kBoth;
  unit.power_level = 0xA8;
  return unit;
}

inline drivers::Hdl64eReadings some_readings() {
  return {core::Time{kEpochNs}, drivers::Hdl64eGps::kPulseAndTime, 41, 0x47,
          drivers::kHdl64ePulse | drivers::kHdl64eGpsTime | drivers::kHdl64eLensDirty};
}

inline drivers::Hdl64eStatusWriter make_writer(
    drivers::Hdl64eChecksum checksum = drivers::Hdl64eChecksum::kCrc) {
  return drivers::Hdl64eStatusWriter::create(some_lasers(), some_unit(), checksum).value();
}

inline std::vector<drivers::Hdl64eStatusByte> one_pass(drivers::Hdl64eStatusWriter writer) {
  std::vector<drivers::Hdl64eStatusByte> stream(drivers::kHdl64eStatusPackets);
  for (drivers::Hdl64eStatusByte& byte : stream) byte = writer.next(some_readings());
  return stream;
}

inline void feed(drivers::Hdl64eStatusReader& reader, std::span<const drivers::Hdl64eStatusByte> stream) {
  for (const drivers::Hdl64eStatusByte& byte : stream) reader.add(byte.type, byte.value);
}

/// Index of the packet that carries byte `place` (0 to 6) of `cycle`.
inline std::size_t packet_of(std::size_t cycle, std::size_t place) { return cycle * 16 + 9 + place; }

/// Packet of byte `i` (0 to 20) of a laser.
inline std::size_t packet_of_laser(std::size_t laser, std::size_t i) {
  return packet_of(1 + 4 * laser + i / 7, i % 7);
}

}  // namespace nilio::tests
