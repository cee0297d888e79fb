#pragma once

#include "nilio/drivers/velodyne/decoder.hpp"

#include "ipc/ring.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace nilio::daemon {

enum class LogLevel : std::uint8_t { kInfo, kWarning, kError };

/// Event of a LiDAR reported by the odometry thread as numbers; the supervisor formats it.
struct LidarEvent {
  enum class Kind : std::uint8_t {
    kStreamStatus,  ///< `model` and `status`, once they are known
    kSilent,        ///< additional LiDAR: no packets arrive
    kLate,          ///< additional LiDAR: packets arrive after the configured wait
    kRecovered,
    kOtherClock,     ///< its clock differs by `offset_s` from the first one's
    kForeignSender,  ///< packets of `other_sender` are not decoded: the sensor is `sender`
    kSenderChanged,  ///< the previous sender is silent, the packets of `sender` are decoded now
    kClockSet,       ///< the sensor's clock was set; its timeline starts again at scan `sequence`
    kHostClockSet,   ///< the computer's clock was set before scan `sequence`
    kModeChanged,    ///< the return mode is status.mode from scan `sequence` on
  };

  Kind kind = Kind::kStreamStatus;
  std::array<char, 8> section{};  ///< "lidar2", cut
  std::array<char, 24> model{};
  drivers::ScanAssemblerStatus status;
  double offset_s = 0.0;
  std::uint64_t sequence = 0;
  /// IPv4, host byte order.
  std::uint32_t sender = 0;
  std::uint32_t other_sender = 0;
};

/// Log lines from the odometry thread, which must not print: events as numbers, and during start-up lines.
/// The supervisor takes both as lines. Lock-free; entries that find the log full are counted.
class EventLog {
 public:
  struct Line {
    LogLevel level = LogLevel::kInfo;
    std::string text;
  };

  EventLog();
  /// Odometry thread only, as log(). Does not allocate.
  void report(const LidarEvent& event) { events_.try_push(event); }
  /// Truncated after 1000 bytes.
  void log(LogLevel level, std::string_view text);
  std::optional<Line> take();
  [[nodiscard]] std::uint64_t dropped() const { return lines_.dropped() + events_.dropped(); }

 private:
  static constexpr std::size_t kTextBytes = 1000;
  struct Slot {
    LogLevel level = LogLevel::kInfo;
    std::uint16_t size = 0;
    std::array<char, kTextBytes> text{};
  };

  ipc::Ring<Slot> lines_;
  ipc::Ring<LidarEvent> events_;
};

/// Human-readable stream status: "VLP-16: return mode single, 600.1 rpm, ...".
std::string describe_status(std::string_view model, const drivers::ScanAssemblerStatus& status);

/// Origin of a LiDAR's times for people: "sensor clock, unsynchronised". Agreement with the host's clock
/// proves no synchronisation.
const char* describe_clock(core::ClockSource source);

/// Copies the name, truncated to the array, with terminating zero.
template <std::size_t kSize>
void copy_name(std::string_view name, std::array<char, kSize>& target) {
  target.fill('\0');
  name.copy(target.data(), kSize - 1);
}

}  // namespace nilio::daemon
