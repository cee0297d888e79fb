#pragma once

#include <functional>
#include <memory>
#include <pthread.h>

namespace nilio::daemon {

/// Thread with a stack of kThreadStackBytes. std::thread's default of 8 MiB would be locked completely in a
/// locked process. Throws std::system_error if no thread can be started.
class PlanThread {
 public:
  explicit PlanThread(std::function<void()> body);
  PlanThread(PlanThread&& other) noexcept = default;
  PlanThread& operator=(PlanThread&&) = delete;
  PlanThread(const PlanThread&) = delete;
  PlanThread& operator=(const PlanThread&) = delete;
  ~PlanThread() = default;

  /// Call exactly once.
  void join();

 private:
  pthread_t thread_{};
  std::unique_ptr<std::function<void()>> body_;
};

}  // namespace nilio::daemon
