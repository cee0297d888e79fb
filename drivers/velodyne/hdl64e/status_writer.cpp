#include "drivers/velodyne/hdl64e/table.hpp"
#include "drivers/velodyne/tables.hpp"

#include <algorithm>

namespace nilio::drivers {
namespace {

std::uint8_t clock_value(const Hdl64eReadings& now, std::size_t position) {
  switch (kHdl64eClockTypes[position]) {
    case 'G':
      return static_cast<std::uint8_t>(now.gps);
    case 'T':
      return now.temperature_degc;
    case 'V':
      return now.firmware;
    default:
      break;
  }
  // Hour, minute, second, day, month, year.
  constexpr std::array<std::size_t, 6> kOrder{3, 4, 5, 2, 1, 0};
  return hdl64e_time_bytes(now.clock)[kOrder[position]];
}

}  // namespace

core::Result<Hdl64eStatusWriter> Hdl64eStatusWriter::create(std::span<const LaserCalibration> lasers,
                                                            const Hdl64eUnit& unit, Hdl64eChecksum checksum) {
  if (lasers.size() != kHdl64eLasers) {
    return core::Error{"HDL-64E status stream: " + std::to_string(lasers.size()) +
                       " lasers, expected 64; take the calibration of an HDL-64E"};
  }
  const auto table = hdl64e_make_table(lasers.first<kHdl64eLasers>(), unit, checksum);
  if (!table) return table.error();
  const auto rounded = hdl64e_lasers(*table);
  if (!rounded) {
    return core::Error{"HDL-64E status stream: implausible laser geometry; check the calibration's units"};
  }
  Hdl64eStatusWriter writer;
  writer.table_ = *table;
  writer.calibration_ = {*rounded, hdl64e_unit(*table), checksum};
  return writer;
}

Hdl64eStatusByte Hdl64eStatusWriter::next(const Hdl64eReadings& now) {
  const std::size_t position = packet_ % kHdl64eStatusCycle;
  const std::size_t cycle = packet_ / kHdl64eStatusCycle;
  packet_ = (packet_ + 1) % kHdl64eStatusPackets;
  if (position == 0) now_ = now;
  if (position < kHdl64eClockBytes) {
    return {static_cast<std::uint8_t>(kHdl64eClockTypes[position]), clock_value(now_, position)};
  }
  const std::size_t place = position - kHdl64eClockBytes;
  const bool warnings = hdl64e_is_warning_cycle(cycle) && place == 0;
  return {hdl64e_type(cycle, place), warnings ? now_.warnings : table_[kHdl64eCycleBytes * cycle + place]};
}

core::Result<VelodyneSensor> with_stream_calibration(VelodyneSensor sensor,
                                                     const Hdl64eCalibration& calibration) {
  if (sensor.lasers.size() != kHdl64eLasers) {
    return core::Error{"a " + sensor.name + " has " + std::to_string(sensor.lasers.size()) +
                       " lasers and sends no calibration; only an HDL-64E does"};
  }
  std::copy(calibration.lasers.begin(), calibration.lasers.end(), sensor.lasers.begin());
  finish_geometry(sensor);
  return sensor;
}

}  // namespace nilio::drivers
