#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

namespace nilio::ipc {

/// An eventfd on which a consumer sleeps until a producer, in this or another process, has something for it.
/// Signals before the consumer sleeps are not lost; several may arrive as one, so look at the ring after
/// every wake-up. notify() and wait() may be called from different threads.
class WakeEvent {
 public:
  /// The descriptor is close-on-exec: whoever starts a process passes it on by dup2.
  static core::Result<WakeEvent> create();
  /// Takes over a descriptor inherited from the parent process; refuses what is not an eventfd.
  static core::Result<WakeEvent> adopt(int file_descriptor);

  WakeEvent(WakeEvent&& other) noexcept;
  WakeEvent& operator=(WakeEvent&& other) noexcept;
  WakeEvent(const WakeEvent&) = delete;
  WakeEvent& operator=(const WakeEvent&) = delete;
  ~WakeEvent();

  /// Never blocks, also when nobody ever waits.
  void notify() noexcept;
  /// True when notified, false after `timeout` or when a signal handler ran.
  bool wait(core::Duration timeout) noexcept;
  /// Forgets signals up to now; for those who poll file_descriptor() together with others.
  void clear() noexcept;
  [[nodiscard]] int file_descriptor() const noexcept { return file_descriptor_; }

 private:
  explicit WakeEvent(int file_descriptor) noexcept : file_descriptor_(file_descriptor) {}

  int file_descriptor_ = -1;
};

}  // namespace nilio::ipc
