#pragma once

#include "nilio/core/time.hpp"

#include <string>
#include <sys/socket.h>
#include <sys/un.h>

namespace nilio::daemon {

/// Sends messages to the service manager with systemd's protocol, sd_notify(3). Without a service manager it
/// sends nothing. Never blocks: a message that the manager has no room for is lost. One thread.
class ServiceNotifier {
 public:
  /// Takes NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID out of the environment, so that no child process
  /// inherits them. Call before any thread starts.
  static ServiceNotifier from_environment();
  ServiceNotifier(ServiceNotifier&& other) noexcept;
  ServiceNotifier& operator=(ServiceNotifier&&) = delete;
  ServiceNotifier(const ServiceNotifier&) = delete;
  ServiceNotifier& operator=(const ServiceNotifier&) = delete;
  ~ServiceNotifier();

  /// A service manager listens.
  [[nodiscard]] bool is_connected() const { return socket_ >= 0; }
  /// Time between two messages "WATCHDOG=1": half the manager's limit; 0 = no watchdog for this process.
  [[nodiscard]] core::Duration ping_period() const { return ping_period_; }
  /// Sends assignments, one a line, such as "READY=1\nSTATUS=tracking". False if they were not delivered.
  [[nodiscard]] bool send(const std::string& assignments) const;

 private:
  ServiceNotifier() = default;

  int socket_ = -1;
  sockaddr_un address_{};
  socklen_t address_size_ = 0;
  core::Duration ping_period_{0};
};

}  // namespace nilio::daemon
