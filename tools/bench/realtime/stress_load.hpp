#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <sys/types.h>
#include <vector>

namespace nilio::tools::bench {

inline constexpr unsigned kLoadProcesses = 2;

/// Processes that load the computer as other programs would. They end with this object and with the thread
/// that created it. Not thread-safe.
class StressLoad {
 public:
  /// Starts `count` processes of normal priority that never sleep.
  static core::Result<StressLoad> cpu_load(unsigned count);
  /// The same at nice -20, above every normal thread. Fails where that is not permitted.
  static core::Result<StressLoad> urgent_cpu_load(unsigned count);
  /// Starts a process that repeatedly allocates that much memory, touches every page and frees it. The kernel
  /// kills it first when memory runs out.
  static core::Result<StressLoad> memory_pressure(std::uint64_t bytes);

  StressLoad(StressLoad&& other) noexcept;
  StressLoad& operator=(StressLoad&&) = delete;
  StressLoad(const StressLoad&) = delete;
  StressLoad& operator=(const StressLoad&) = delete;
  ~StressLoad();

  [[nodiscard]] const std::vector<pid_t>& processes() const { return processes_; }
  /// False once one of them has ended.
  [[nodiscard]] bool is_running() const;

 private:
  StressLoad() = default;

  std::vector<pid_t> processes_;
};

/// Size for memory_pressure(): nine tenths of the available memory, at most `maximum`; 0 where the kernel
/// does not report it.
std::uint64_t pressure_bytes(std::uint64_t maximum);

}  // namespace nilio::tools::bench
