#include "drivers/velodyne/hdl64e/table.hpp"

#include <algorithm>

namespace nilio::drivers {
namespace {

/// True if the type is valid at this place of the cycle, or of any cycle while it is unknown.
bool fits_table(std::uint8_t type, std::size_t place, std::optional<std::size_t> cycle) {
  if (type == '1' + place) return true;
  if (cycle) return type == hdl64e_type(*cycle, place);
  // One cycle of each kind with special types.
  constexpr std::array<std::size_t, 4> kKinds{0, 4, 257, 259};
  return std::any_of(kKinds.begin(), kKinds.end(),
                     [&](std::size_t kind) { return type == hdl64e_type(kind, place); });
}

bool fits(std::uint8_t type, std::size_t position, std::optional<std::size_t> cycle) {
  if (position < kHdl64eClockBytes) return type == static_cast<std::uint8_t>(kHdl64eClockTypes[position]);
  return fits_table(type, position - kHdl64eClockBytes, cycle);
}

Hdl64eGps to_gps(std::uint8_t value) {
  for (const Hdl64eGps gps :
       {Hdl64eGps::kNone, Hdl64eGps::kPulseAndTime, Hdl64eGps::kTimeOnly, Hdl64eGps::kPulseOnly}) {
    if (value == static_cast<std::uint8_t>(gps)) return gps;
  }
  return Hdl64eGps::kUnknown;
}

bool is_marker(std::span<const std::uint8_t> bytes) {
  return std::equal(kHdl64eMarker.begin(), kHdl64eMarker.end(), bytes.begin(),
                    [](char c, std::uint8_t byte) { return static_cast<std::uint8_t>(c) == byte; });
}

/// False if the bytes contradict the cycle.
bool matches_cycle(std::span<const std::uint8_t> bytes, std::size_t cycle) {
  if (cycle == 0) return is_marker(bytes);
  const std::optional<std::size_t> laser = hdl64e_laser_of_cycle(cycle);
  return !laser || bytes[0] == *laser;
}

}  // namespace

void Hdl64eStatusReader::add(std::uint8_t type, std::uint8_t value) {
  if (position_ && !fits(type, *position_, cycle_)) {
    break_order();
    // The position in the cycle remains valid when only the cycle number was wrong.
    if (!fits(type, *position_, cycle_)) position_.reset();
  }
  if (!position_) {
    if (type != static_cast<std::uint8_t>(kHdl64eClockTypes.front())) return;
    position_ = 0;
  }
  values_[*position_] = value;
  ++*position_;
  if (*position_ == kHdl64eClockBytes) finish_clock();
  if (*position_ < kHdl64eStatusCycle) return;
  position_ = 0;
  ++counters_.cycles;
  finish_cycle();
}

void Hdl64eStatusReader::note_loss() {
  if (position_) break_order();
  position_.reset();
}

void Hdl64eStatusReader::break_order() {
  ++counters_.gaps;
  cycle_.reset();
}

/// The bytes of the clock arrive one by one: a minute that ends between two of them makes an invalid time.
/// Hence a time is accepted only if it equals that of the previous cycle or is one second later.
void Hdl64eStatusReader::finish_clock() {
  const std::array<std::uint8_t, 6> time{values_[5], values_[4], values_[3],
                                         values_[0], values_[1], values_[2]};
  const std::optional<core::Time> clock = hdl64e_time(time);
  Hdl64eReadings readings = readings_.value_or(Hdl64eReadings{});
  if (!clock) {
    readings.clock.reset();
  } else if (previous_clock_ &&
             (clock == previous_clock_ || *clock == *previous_clock_ + core::Duration::from_seconds(1.0))) {
    readings.clock = clock;
  }
  previous_clock_ = clock;
  readings.gps = to_gps(values_[6]);
  readings.temperature_degc = values_[7];
  readings.firmware = values_[8];
  readings_ = readings;
}

void Hdl64eStatusReader::finish_cycle() {
  const auto bytes = std::span(values_).subspan<kHdl64eClockBytes>();
  if (cycle_ && !matches_cycle(bytes, *cycle_)) break_order();
  if (!cycle_) {
    if (!is_marker(bytes)) return;
    cycle_ = 0;
  }
  const std::size_t cycle = *cycle_;
  std::copy(bytes.begin(), bytes.end(),
            table_.begin() + static_cast<std::ptrdiff_t>(kHdl64eCycleBytes * cycle));
  if (hdl64e_is_warning_cycle(cycle)) readings_->warnings = bytes[0];
  cycle_ = (cycle + 1) % kHdl64eStatusCycles;
  if (*cycle_ == 0) finish_table();
}

void Hdl64eStatusReader::finish_table() {
  const std::uint16_t sent = hdl64e_sent_crc(table_);
  const bool crc_right = sent == hdl64e_computed_crc(table_, Hdl64eCrcOrder::kManual) ||
                         sent == hdl64e_computed_crc(table_, Hdl64eCrcOrder::kStream);
  if (!crc_right && sent != kHdl64eNoCrc) {
    ++counters_.wrong_crc;
    return;
  }
  const auto lasers = hdl64e_lasers(table_);
  if (!lasers) {
    ++counters_.implausible;
    return;
  }
  ++counters_.tables;
  calibration_ = Hdl64eCalibration{*lasers, hdl64e_unit(table_),
                                   crc_right ? Hdl64eChecksum::kCrc : Hdl64eChecksum::kNone};
}

}  // namespace nilio::drivers
