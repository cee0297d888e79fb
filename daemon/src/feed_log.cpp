#include "nilio/daemon/feed_log.hpp"

#include <algorithm>
#include <span>

namespace nilio::daemon {

namespace {

// Every line is said once, so that these are never all in use.
constexpr std::size_t kLines = 128;

}  // namespace

FeedLog::FeedLog() : ring_(ipc::Ring<Slot>::in_private_memory(kLines)) {}

void FeedLog::say(LogLevel level, std::string_view text) {
  const std::span<Slot> slot = ring_.begin_write(1);
  if (slot.empty()) {
    ring_.count_dropped(1);
    return;
  }
  const std::string_view kept = text.substr(0, kTextBytes);
  slot[0].level = level;
  slot[0].size = static_cast<std::uint16_t>(kept.size());
  std::copy(kept.begin(), kept.end(), slot[0].text.begin());
  ring_.commit(1);
}

std::optional<FeedLog::Line> FeedLog::take() {
  const std::optional<Slot> slot = ring_.try_pop();
  if (!slot) return std::nullopt;
  return Line{slot->level, std::string(slot->text.data(), slot->size)};
}

}  // namespace nilio::daemon
