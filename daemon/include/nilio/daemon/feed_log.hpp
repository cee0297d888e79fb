#pragma once

#include "nilio/ipc/ring.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace nilio::daemon {

enum class LogLevel : std::uint8_t { kInfo, kWarning, kError };

/// Lines for the log from the odometry thread, which must not write them itself: one thread says them, the
/// supervisor takes them. Lock-free; a line that finds the log full is counted.
class FeedLog {
 public:
  struct Line {
    LogLevel level = LogLevel::kInfo;
    std::string text;
  };

  FeedLog();
  /// Cut after 1000 bytes.
  void say(LogLevel level, std::string_view text);
  std::optional<Line> take();
  [[nodiscard]] std::uint64_t dropped() const { return ring_.dropped(); }

 private:
  static constexpr std::size_t kTextBytes = 1000;
  struct Slot {
    LogLevel level = LogLevel::kInfo;
    std::uint16_t size = 0;
    std::array<char, kTextBytes> text{};
  };

  ipc::Ring<Slot> ring_;
};

}  // namespace nilio::daemon
