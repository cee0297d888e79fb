#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include <filesystem>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

namespace nilio::tools {

/// A child process with its output in a file. It is killed with this object, and by the kernel when the
/// thread that started it ends. One thread.
class ChildProcess {
 public:
  /// Starts `program` with `arguments`, this program's environment and `more_environment` ("NAME=value") over
  /// it; standard output and error go to `log`. Fails when the log cannot be written or the program cannot be
  /// started.
  static core::Result<ChildProcess> start(const std::filesystem::path& program,
                                          const std::vector<std::string>& arguments,
                                          const std::filesystem::path& log,
                                          std::vector<std::string> more_environment = {});
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&& other) noexcept;
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;
  ~ChildProcess();

  [[nodiscard]] pid_t pid() const { return pid_; }
  /// The exit status, or minus the signal that killed it; unset while it runs.
  std::optional<int> poll();
  void send_signal(int signal) const;
  /// Sends SIGTERM, and SIGKILL if it has not ended after `patience`; returns the result of poll().
  int stop(core::Duration patience);
  /// The last non-empty line of its output, for messages.
  [[nodiscard]] std::string last_line() const;

 private:
  ChildProcess(pid_t pid, std::filesystem::path log) : pid_(pid), log_(std::move(log)) {}
  void kill_and_reap();

  pid_t pid_ = -1;
  std::filesystem::path log_;
  std::optional<int> ended_;
};

/// Path of a program that was built or installed beside this one.
core::Result<std::filesystem::path> find_sibling_program(const std::string& name);

}  // namespace nilio::tools
