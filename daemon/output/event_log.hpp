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

/// What the odometry thread has to tell of a LiDAR; numbers, which somebody else puts into words.
struct FeedEvent {
  enum class Kind : std::uint8_t {
    kStreamStatus,  ///< `model` and `status`, once they are known
    kSilent,        ///< of a LiDAR beside the first: no packets come
    kLate,          ///< its packets come later than they are waited for
    kInTimeAgain,
    kOtherClock,  ///< its clock is `offset_s` from the first one's
  };

  Kind kind = Kind::kStreamStatus;
  std::array<char, 8> section{};  ///< "lidar2", cut
  std::array<char, 24> model{};
  drivers::ScanAssemblerStatus status;
  double offset_s = 0.0;
};

/// Lines for the log from threads that must not write them themselves. The odometry thread reports events,
/// the thread that searches for sensors says lines, the supervisor takes both as lines. Lock-free; what finds
/// the log full is counted.
class FeedLog {
 public:
  struct Line {
    LogLevel level = LogLevel::kInfo;
    std::string text;
  };

  FeedLog();
  /// By the odometry thread only. Does not allocate.
  void report(const FeedEvent& event) { events_.try_push(event); }
  /// By one other thread only. Cut after 1000 bytes.
  void say(LogLevel level, std::string_view text);
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
  ipc::Ring<FeedEvent> events_;
};

/// "VLP-16: return mode single, 600.1 rpm, ..." for people.
std::string describe_status(std::string_view model, const drivers::ScanAssemblerStatus& status);

/// Copies as much as there is room for, with a zero at the end.
template <std::size_t kSize>
void copy_name(std::string_view name, std::array<char, kSize>& target) {
  target.fill('\0');
  name.copy(target.data(), kSize - 1);
}

}  // namespace nilio::daemon
