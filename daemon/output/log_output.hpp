#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

namespace nilio::daemon {

struct LogOutputConfig {
  int file_descriptor = 1;
  std::string level = "info";
  /// Lines that wait to be written; with more the oldest are lost, and counted.
  std::size_t queue_lines = 2048;
};

/// Puts what spdlog is given onto an output by a thread of its own, at normal priority, so that nobody waits
/// for a full pipe or a slow disk: lines that find the queue full push out the oldest, and the output says
/// how many. While it exists it is spdlog's default logger; there is one at a time. Made and destroyed by the
/// main thread.
class LogOutput {
 public:
  explicit LogOutput(const LogOutputConfig& config);
  /// Writes what waits, as long as the reader takes some of it every 2 s.
  ~LogOutput();
  LogOutput(const LogOutput&) = delete;
  LogOutput& operator=(const LogOutput&) = delete;

  [[nodiscard]] std::uint64_t lines_lost() const;

 private:
  class Sink;
  struct State;
  std::unique_ptr<State> state_;
};

/// When the process is about to end by a fault or abort(), lets the logger write what waits, for at most a
/// second, and names the signal. Signals that somebody else handles are left to them.
void write_log_before_dying();

}  // namespace nilio::daemon
