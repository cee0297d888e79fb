#pragma once

#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <ctime>
#include <optional>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace nilio::drivers {

/// Size of the header of a datagram, bytes.
inline constexpr std::size_t kUdpHeader = 8;

/// Owns a file descriptor and closes it; -1 owns none.
class FileDescriptor {
 public:
  FileDescriptor() = default;
  explicit FileDescriptor(int descriptor) : descriptor_(descriptor) {}
  FileDescriptor(FileDescriptor&& other) noexcept : descriptor_(other.release()) {}
  FileDescriptor& operator=(FileDescriptor&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  FileDescriptor(const FileDescriptor&) = delete;
  FileDescriptor& operator=(const FileDescriptor&) = delete;
  ~FileDescriptor() { close(); }

  void close() {
    if (descriptor_ >= 0) ::close(release());
  }
  [[nodiscard]] int release() { return std::exchange(descriptor_, -1); }
  [[nodiscard]] int get() const { return descriptor_; }
  [[nodiscard]] bool is_open() const { return descriptor_ >= 0; }

 private:
  int descriptor_ = -1;
};

template <class Value>
bool set_socket_option(int descriptor, int level, int option, const Value& value) {
  return setsockopt(descriptor, level, option, &value, sizeof(value)) == 0;
}

/// Requests a receive buffer of `bytes` and returns the obtained size without the kernel's own share. Sizes
/// above net.core.rmem_max need CAP_NET_ADMIN. Empty when the kernel does not report the size (errno).
std::optional<int> request_receive_buffer(int descriptor, int bytes);

/// "receive buffer 8192 KiB", with the sysctl that raises the limit when less than requested was obtained.
std::string describe_receive_buffer(int obtained, int requested);

/// Room for the kernel's time stamp and drop counter of one message.
struct ControlBuffer {
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(std::uint32_t))> bytes{};
};

/// Content of a ControlBuffer after reception (SO_TIMESTAMPNS, SO_RXQ_OVFL).
struct ReceivedControl {
  /// Kernel receive time, or CLOCK_REALTIME now when the kernel gave none.
  core::Time stamp;
  /// Messages that the socket had dropped in all at the time of reception, modulo 2^32.
  std::optional<std::uint32_t> drops;
};
ReceivedControl read_control(msghdr& header);

}  // namespace nilio::drivers
