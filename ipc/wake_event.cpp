#include "ipc/wake_event.hpp"

#include "nilio/core/clock.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <fcntl.h>
#include <poll.h>
#include <string>
#include <sys/eventfd.h>
#include <unistd.h>
#include <utility>

namespace nilio::ipc {

core::Result<WakeEvent> WakeEvent::create() {
  const int file_descriptor = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (file_descriptor < 0) return core::Error{std::string("eventfd: ") + std::strerror(errno)};
  return WakeEvent(file_descriptor);
}

core::Result<WakeEvent> WakeEvent::adopt(int file_descriptor) {
  const std::string where = "file descriptor " + std::to_string(file_descriptor);
  std::array<char, 64> target{};
  const std::string link = "/proc/self/fd/" + std::to_string(file_descriptor);
  if (fcntl(file_descriptor, F_GETFD) < 0) return core::Error{where + " is not open (it must be an eventfd)"};
  const ssize_t length = readlink(link.c_str(), target.data(), target.size() - 1);
  // Without /proc the kind is unknown; a wrong descriptor then only costs wake-ups.
  if (length > 0 && std::strstr(target.data(), "eventfd") == nullptr)
    return core::Error{where + " is not an eventfd but " + target.data()};
  if (fcntl(file_descriptor, F_SETFL, O_NONBLOCK) != 0 || fcntl(file_descriptor, F_SETFD, FD_CLOEXEC) != 0)
    return core::Error{where + ": " + std::strerror(errno)};
  return WakeEvent(file_descriptor);
}

WakeEvent::WakeEvent(WakeEvent&& other) noexcept
    : file_descriptor_(std::exchange(other.file_descriptor_, -1)) {}

WakeEvent& WakeEvent::operator=(WakeEvent&& other) noexcept {
  std::swap(file_descriptor_, other.file_descriptor_);
  return *this;
}

WakeEvent::~WakeEvent() {
  if (file_descriptor_ >= 0) close(file_descriptor_);
}

void WakeEvent::notify() noexcept {
  const std::uint64_t one = 1;
  // Fails only with 2^64 - 2 pending signals, when the reader is signalled anyway.
  [[maybe_unused]] const ssize_t written = write(file_descriptor_, &one, sizeof one);
}

bool WakeEvent::wait(core::Duration timeout) noexcept {
  const timespec limit = to_timespec(timeout);
  pollfd waited{file_descriptor_, POLLIN, 0};
  if (ppoll(&waited, 1, &limit, nullptr) <= 0) return false;
  clear();
  return true;
}

void WakeEvent::clear() noexcept {
  std::uint64_t count = 0;
  [[maybe_unused]] const ssize_t bytes = read(file_descriptor_, &count, sizeof count);
}

}  // namespace nilio::ipc
