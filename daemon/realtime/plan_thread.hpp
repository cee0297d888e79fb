#pragma once

#include <functional>
#include <memory>
#include <pthread.h>

namespace nilio::daemon {

/// A thread whose stack has kThreadStackBytes: std::thread's have 8 MiB, all of which a locked process would
/// hold in memory. Throws std::system_error when the kernel has no more threads.
class PlanThread {
 public:
  explicit PlanThread(std::function<void()> body);
  PlanThread(PlanThread&& other) noexcept = default;
  PlanThread& operator=(PlanThread&&) = delete;
  PlanThread(const PlanThread&) = delete;
  PlanThread& operator=(const PlanThread&) = delete;
  ~PlanThread() = default;

  /// Has to be called once.
  void join();

 private:
  pthread_t thread_{};
  std::unique_ptr<std::function<void()>> body_;
};

}  // namespace nilio::daemon
