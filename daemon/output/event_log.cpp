#include "daemon/output/event_log.hpp"

#include <algorithm>
#include <cstdio>
#include <span>

namespace nilio::daemon {

namespace {

// Every line is logged once, so this capacity is not reached.
constexpr std::size_t kLines = 128;

std::string address_text(std::uint32_t address) {
  std::array<char, 16> text{};
  std::snprintf(text.data(), text.size(), "%u.%u.%u.%u", address >> 24U, address >> 16U & 0xFFU,
                address >> 8U & 0xFFU, address & 0xFFU);
  return text.data();
}

EventLog::Line to_line(const LidarEvent& event) {
  const std::string section(event.section.data());
  const std::string scan = "scan " + std::to_string(event.sequence);
  switch (event.kind) {
    case LidarEvent::Kind::kStreamStatus:
      return {LogLevel::kInfo,
              (section == "lidar" ? "" : section + ": ") + describe_status(event.model.data(), event.status)};
    case LidarEvent::Kind::kSilent:
      return {LogLevel::kWarning, section + ": no packets received; poses are computed without it"};
    case LidarEvent::Kind::kLate:
      return {LogLevel::kWarning, section + ": packets arrive later than " + section +
                                      ".wait_ms allows; poses use those that arrived in time"};
    case LidarEvent::Kind::kRecovered:
      return {LogLevel::kInfo, section + ": packets arrive in time again"};
    case LidarEvent::Kind::kForeignSender:
      return {LogLevel::kWarning, section + ": packets from " + address_text(event.other_sender) +
                                      " are counted and not decoded; the sensor is " +
                                      address_text(event.sender) +
                                      " - give that sender another port, or set " + section +
                                      ".sender_address to the sensor wanted"};
    case LidarEvent::Kind::kSenderChanged:
      return {LogLevel::kWarning, section + ": packets now come from " + address_text(event.sender) +
                                      ", the previous sender is silent; its sensor is identified "
                                      "again, map and pose are kept"};
    case LidarEvent::Kind::kClockSet:
      return {LogLevel::kWarning, scan + ": the clock of " + section +
                                      " was set, or the sensor was restarted; its timeline starts again, map "
                                      "and pose are kept"};
    case LidarEvent::Kind::kHostClockSet:
      return {LogLevel::kWarning, scan + ": the computer's clock was set; the time stamps of " + section +
                                      " follow it (forward at once, backward slowly), map and pose are kept"};
    case LidarEvent::Kind::kModeChanged:
      return {LogLevel::kInfo, scan + ": return mode of " + section + " is " +
                                   std::string(drivers::return_mode_name(event.status.mode)) +
                                   " now; map and pose are kept"};
    case LidarEvent::Kind::kOtherClock:
      break;
  }
  std::array<char, 32> offset{};
  std::snprintf(offset.data(), offset.size(), "%+.3f", event.offset_s);
  return {LogLevel::kWarning, section + ": clock differs by " + offset.data() +
                                  " s from that of lidar; its points belong to no scan - synchronize both "
                                  "clocks to the same GPS, or set lidar.time_source and " +
                                  section + ".time_source to host"};
}

}  // namespace

std::string describe_status(std::string_view model, const drivers::ScanAssemblerStatus& status) {
  std::array<char, 256> text{};
  std::snprintf(text.data(), text.size(),
                "%s: return mode %s, %.1f rpm, a packet every %.1f us, field of view %.0f deg, time %s, "
                "offset %.6f s, drift %.1f ppm",
                std::string(model).c_str(), std::string(drivers::return_mode_name(status.mode)).c_str(),
                status.revolutions_per_minute, status.packet_period_us, 360.0 - status.blind_sector_deg,
                core::name_of(status.clock_source), status.clock_offset_s, status.clock_drift_ppm);
  return text.data();
}

EventLog::EventLog()
    : lines_(ipc::Ring<Slot>::in_private_memory(kLines)),
      events_(ipc::Ring<LidarEvent>::in_private_memory(kLines)) {}

void EventLog::log(LogLevel level, std::string_view text) {
  const std::span<Slot> slot = lines_.begin_write(1);
  if (slot.empty()) {
    lines_.count_dropped(1);
    return;
  }
  const std::string_view kept = text.substr(0, kTextBytes);
  slot[0].level = level;
  slot[0].size = static_cast<std::uint16_t>(kept.size());
  std::copy(kept.begin(), kept.end(), slot[0].text.begin());
  lines_.commit(1);
}

std::optional<EventLog::Line> EventLog::take() {
  if (const std::optional<Slot> slot = lines_.try_pop())
    return Line{slot->level, std::string(slot->text.data(), slot->size)};
  if (const std::optional<LidarEvent> event = events_.try_pop()) return to_line(*event);
  return std::nullopt;
}

const char* describe_clock(core::ClockSource source) {
  switch (source) {
    case core::ClockSource::kHost:
      return "receive times of the host";
    case core::ClockSource::kFreeRunning:
      return "sensor clock, unsynchronised";
    case core::ClockSource::kNmeaOnly:
      return "sensor clock, GPS time without PPS";
    case core::ClockSource::kPpsLocked:
      return "sensor clock, PPS locked";
    case core::ClockSource::kPtp:
      return "sensor clock, in step with the host's without PPS: PTP, if the firmware has it";
    case core::ClockSource::kHostAgreement:
      break;
  }
  return "sensor clock, unsynchronised as far as its packets tell, in step with the host's";
}

}  // namespace nilio::daemon
