#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <sys/types.h>
#include <vector>

namespace nilio::tools {

/// Processes that take what a computer has, as other programs would; they end with this object, and with the
/// thread that made it. One thread.
class BackgroundLoad {
 public:
  /// `count` processes at normal priority that never sleep.
  static core::Result<BackgroundLoad> cpu_hogs(unsigned count);
  /// A process that takes so many bytes, touches every page, gives them back, and begins again. It is what
  /// the kernel kills first when memory ends.
  static core::Result<BackgroundLoad> memory_pressure(std::uint64_t bytes);

  BackgroundLoad(BackgroundLoad&& other) noexcept;
  BackgroundLoad& operator=(BackgroundLoad&&) = delete;
  BackgroundLoad(const BackgroundLoad&) = delete;
  BackgroundLoad& operator=(const BackgroundLoad&) = delete;
  ~BackgroundLoad();

  [[nodiscard]] const std::vector<pid_t>& processes() const { return processes_; }
  /// False when one of them was killed.
  [[nodiscard]] bool is_running() const;

 private:
  BackgroundLoad() = default;

  std::vector<pid_t> processes_;
};

/// What the pressure takes: nine tenths of the memory that is free or can be made so, `most` at most; 0 where
/// the kernel does not tell.
std::uint64_t pressure_bytes(std::uint64_t most);

}  // namespace nilio::tools
