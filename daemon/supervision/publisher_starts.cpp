#include "daemon/supervision/publisher_starts.hpp"

#include <utility>

namespace nilio::daemon {

using Kind = ipc::ProcessEvent::Kind;

std::optional<EventLog::Line> PublisherStarts::observe(const ipc::PublisherEvent& event,
                                                       std::uint64_t heartbeat) {
  if (event.kind == Kind::kStarted) {
    beats_at_start_ = heartbeat;
    if (failed_starts_ > 0) return std::nullopt;
    return EventLog::Line{LogLevel::kInfo, event.message};
  }
  // A process that was told to stop may have had no time to begin.
  const bool ends_by_itself =
      event.kind == Kind::kDied || (event.kind == Kind::kStopped && event.exit_status > 0);
  const bool failed = event.kind == Kind::kStartFailed || (ends_by_itself && heartbeat == beats_at_start_);
  if (!failed) {
    if (event.kind == Kind::kStopped && event.unpublished == 0) return std::nullopt;
    return EventLog::Line{LogLevel::kWarning, event.message};
  }
  // The message may end with the time of the next start.
  const std::string reason = event.message.substr(0, event.message.find(", next start"));
  if (heartbeat == 0) failure_ = reason;
  if (failed_starts_++ > 0) return std::nullopt;
  return EventLog::Line{
      LogLevel::kError,
      reason +
          "; poses continue without DDS, and the start is repeated every second - check the "
          "lines of nilio-publisher above, or set publisher.enabled to false"};
}

std::optional<EventLog::Line> PublisherStarts::observe(std::uint64_t heartbeat) {
  if (heartbeat == beats_at_start_ || failed_starts_ == 0) return std::nullopt;
  failure_.clear();
  return EventLog::Line{
      LogLevel::kInfo,
      "publisher runs after " + std::to_string(std::exchange(failed_starts_, 0)) + " failed starts"};
}

}  // namespace nilio::daemon
