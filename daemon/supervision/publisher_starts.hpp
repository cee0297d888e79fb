#pragma once

#include "daemon/output/event_log.hpp"
#include "ipc/publisher_process.hpp"

#include <cstdint>
#include <optional>
#include <string>

namespace nilio::daemon {

/// Turns the events of nilio-publisher into log lines: a process that cannot start is one error, however
/// often its start is repeated, and one line when it succeeds. One thread.
class PublisherStarts {
 public:
  /// `heartbeat`: PublisherState::heartbeat(). Call for the failure of the first start, too.
  std::optional<EventLog::Line> observe(const ipc::PublisherEvent& event, std::uint64_t heartbeat);
  /// Call often: reports that a start succeeded after failed ones.
  std::optional<EventLog::Line> observe(std::uint64_t heartbeat);
  /// Why nothing was published; empty if the process ran, or was not seen to fail.
  [[nodiscard]] const std::string& failure() const { return failure_; }

 private:
  std::uint64_t beats_at_start_ = 0;
  std::uint64_t failed_starts_ = 0;  ///< in a row
  std::string failure_;
};

}  // namespace nilio::daemon
