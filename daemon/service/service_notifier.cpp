#include "daemon/service/service_notifier.hpp"

#include <charconv>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <string_view>
#include <unistd.h>
#include <utility>

namespace nilio::daemon {

namespace {

/// Value of a variable, which is removed from the environment; empty if unset.
std::string take_variable(const char* name) {
  const char* const value = std::getenv(name);
  std::string text = value == nullptr ? "" : value;
  unsetenv(name);
  return text;
}

/// 0 unless the whole text is a number.
std::int64_t parse_number(std::string_view text) {
  std::int64_t number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc{} && end == text.data() + text.size() ? number : 0;
}

}  // namespace

ServiceNotifier ServiceNotifier::from_environment() {
  ServiceNotifier notifier;
  const std::string path = take_variable("NOTIFY_SOCKET");
  const std::int64_t limit_us = parse_number(take_variable("WATCHDOG_USEC"));
  const std::string watched = take_variable("WATCHDOG_PID");
  const bool is_address = path.starts_with('/') || path.starts_with('@');
  if (!is_address || path.size() >= sizeof notifier.address_.sun_path) return notifier;
  notifier.address_.sun_family = AF_UNIX;
  path.copy(notifier.address_.sun_path, path.size());
  // An abstract address begins with NUL and is not terminated.
  if (path.front() == '@') notifier.address_.sun_path[0] = '\0';
  notifier.address_size_ = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + path.size());
  notifier.socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const bool is_own = watched.empty() || parse_number(watched) == getpid();
  if (limit_us > 0 && is_own) notifier.ping_period_ = core::Duration{limit_us * 1000 / 2};
  return notifier;
}

ServiceNotifier::ServiceNotifier(ServiceNotifier&& other) noexcept
    : socket_(std::exchange(other.socket_, -1)),
      address_(other.address_),
      address_size_(other.address_size_),
      ping_period_(other.ping_period_) {}

ServiceNotifier::~ServiceNotifier() {
  if (socket_ >= 0) close(socket_);
}

bool ServiceNotifier::send(const std::string& assignments) const {
  if (!is_connected()) return false;
  const ssize_t sent = sendto(socket_, assignments.data(), assignments.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
                              reinterpret_cast<const sockaddr*>(&address_), address_size_);
  return sent == static_cast<ssize_t>(assignments.size());
}

}  // namespace nilio::daemon
