#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

namespace nilio::ipc {

/// eventfd on which a consumer sleeps until a producer in this or another process signals data. Signals
/// before the sleep are not lost; several may merge into one, so check the ring after every wake-up. notify()
/// and wait() may be called from different threads.
class WakeEvent {
 public:
  /// Creates an eventfd. It is close-on-exec: a child process gets it by dup2.
  static core::Result<WakeEvent> create();
  /// Takes ownership of an inherited descriptor; fails if it is not an eventfd.
  static core::Result<WakeEvent> adopt(int file_descriptor);

  /// The moved-from object may only be destroyed or assigned.
  WakeEvent(WakeEvent&& other) noexcept;
  WakeEvent& operator=(WakeEvent&& other) noexcept;
  WakeEvent(const WakeEvent&) = delete;
  WakeEvent& operator=(const WakeEvent&) = delete;
  ~WakeEvent();

  /// Wakes the consumer. Never blocks, even if nobody waits.
  void notify() noexcept;
  /// True if notified, false after `timeout` or an interruption by a signal handler.
  bool wait(core::Duration timeout) noexcept;
  /// Clears pending signals; for callers that poll file_descriptor() together with others.
  void clear() noexcept;
  /// Descriptor for poll() and for passing to a child process; stays owned by this object.
  [[nodiscard]] int file_descriptor() const noexcept { return file_descriptor_; }

 private:
  explicit WakeEvent(int file_descriptor) noexcept : file_descriptor_(file_descriptor) {}

  int file_descriptor_ = -1;
};

}  // namespace nilio::ipc
