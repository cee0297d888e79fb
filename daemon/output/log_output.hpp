#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace nilio::daemon {

struct LogOutputConfig {
  int file_descriptor = 1;
  std::string level = "info";
  /// Capacity of the queue; when it is full, the oldest lines are dropped and counted.
  std::size_t queue_lines = 2048;
};

/// Writes spdlog's lines to an output from a thread of its own at normal priority, so that no thread blocks
/// on a full pipe or a slow disk. A full queue drops the oldest lines and reports how many. It is spdlog's
/// default logger while it exists; one instance at a time. Create and destroy it in the main thread.
class LogOutput {
 public:
  explicit LogOutput(const LogOutputConfig& config);
  /// Writes the queued lines as long as the reader takes data at least every 0.3 s.
  ~LogOutput();
  LogOutput(const LogOutput&) = delete;
  LogOutput& operator=(const LogOutput&) = delete;

  [[nodiscard]] std::uint64_t lines_lost() const;

 private:
  class Sink;
  struct State;
  std::unique_ptr<State> state_;
};

/// Installs handlers for faults and abort() that let the logger write its queue for at most one second and
/// name the signal. Signals with another handler are left alone.
void write_log_before_dying();

}  // namespace nilio::daemon
