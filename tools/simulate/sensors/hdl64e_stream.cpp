#include "tools/simulate/sensors/hdl64e_stream.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using drivers::Hdl64eReadings;
using drivers::Hdl64eStatusByte;
using drivers::Hdl64eStatusWriter;

/// H M S D N Y G T V, then bytes of the calibration.
constexpr std::size_t kClockBytes = 9;
constexpr std::int64_t kDayNs = 86'400'000'000'000;
/// 2000-01-01: date of the clock without GPS.
constexpr std::int64_t kNoGpsNs = 946'684'800'000'000'000;

Hdl64eReadings readings(GpsReception gps, core::Time clock) {
  Hdl64eReadings now;
  now.temperature_degc = 40;
  now.firmware = 0x20;
  switch (gps) {
    case GpsReception::kLocked:
      now.gps = drivers::Hdl64eGps::kPulseAndTime;
      now.warnings = drivers::kHdl64ePulse | drivers::kHdl64eGpsTime;
      break;
    case GpsReception::kNmeaOnly:
      now.gps = drivers::Hdl64eGps::kTimeOnly;
      now.warnings = drivers::kHdl64eGpsTime;
      break;
    case GpsReception::kNone:
      now.gps = drivers::Hdl64eGps::kNone;
      break;
  }
  now.clock = gps == GpsReception::kNone ? core::Time{kNoGpsNs + clock.ns % kDayNs} : clock;
  return now;
}

drivers::Hdl64eUnit unit_of(drivers::ReturnMode mode, double revolutions_per_minute) {
  drivers::Hdl64eUnit unit;
  unit.upper_threshold = 20;
  unit.lower_threshold = 20;
  unit.calibrated = core::Time{1'735'689'600'000'000'000};  // 2025-01-01
  unit.motor_rpm = static_cast<std::int16_t>(std::lround(revolutions_per_minute));
  unit.field_of_view_end = drivers::kAzimuthModulus - 1;
  unit.life_hours = 100;
  unit.source_address = 0xC0A801C9;
  unit.destination_address = 0xFFFFFFFF;
  unit.returns =
      mode == drivers::ReturnMode::kSingle ? drivers::Hdl64eReturn::kStrongest : drivers::Hdl64eReturn::kBoth;
  unit.power_level = 0xA8;
  return unit;
}

/// Writer with zero calibration, which always fits the stream.
Hdl64eStatusWriter blank_writer() {
  const std::array<drivers::LaserCalibration, drivers::kHdl64eLasers> lasers{};
  return Hdl64eStatusWriter::create(lasers, {}).value();
}

}  // namespace

bool has_status_stream(drivers::VelodyneModel model) {
  using enum drivers::VelodyneModel;
  return model == kHdl64eS2 || model == kHdl64eS21 || model == kHdl64eS3;
}

Hdl64eStream::Hdl64eStream(GpsReception gps, Hdl64eStatusWriter writer) : gps_(gps), writer_(writer) {
  Hdl64eStatusWriter pass = writer_;
  std::generate(pass_.begin(), pass_.end(), [&] { return pass.next(readings(gps_, {})); });
}

Hdl64eStream::Hdl64eStream(GpsReception gps) : Hdl64eStream(gps, blank_writer()) {
  for (std::size_t i = 0; i < pass_.size(); ++i) {
    const std::size_t position = i % drivers::kHdl64eStatusCycle;
    if (position >= kClockBytes) pass_[i] = {static_cast<std::uint8_t>('1' + position - kClockBytes), 0};
  }
}

core::Result<Hdl64eStream> Hdl64eStream::with_calibration(const drivers::VelodyneSensor& sensor,
                                                          drivers::ReturnMode mode,
                                                          double revolutions_per_minute, GpsReception gps) {
  // Only the S3 has a CRC.
  const auto checksum = sensor.model == drivers::VelodyneModel::kHdl64eS3 ? drivers::Hdl64eChecksum::kCrc
                                                                          : drivers::Hdl64eChecksum::kNone;
  auto writer = Hdl64eStatusWriter::create(sensor.lasers, unit_of(mode, revolutions_per_minute), checksum);
  if (!writer) return writer.error();
  Hdl64eStream stream(gps, std::move(writer).value());
  stream.calibration_ = stream.writer_.calibration();
  return stream;
}

Hdl64eStatusByte Hdl64eStream::at(std::uint64_t packet, core::Time clock) const {
  const std::size_t position = packet % drivers::kHdl64eStatusCycle;
  if (position >= kClockBytes) return pass_[packet % pass_.size()];
  // All cycles begin with the same bytes.
  Hdl64eStatusWriter cycle = writer_;
  Hdl64eStatusByte byte;
  for (std::size_t i = 0; i <= position; ++i) byte = cycle.next(readings(gps_, clock));
  return byte;
}

}  // namespace nilio::tools::simulate
