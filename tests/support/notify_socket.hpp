#pragma once

#include "tests/support/eventually.hpp"

#include <array>
#include <cstddef>
#include <cstring>
#include <string>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// The socket of a service manager. `address` is as in NOTIFY_SOCKET: a path, or '@' and an abstract name.
class NotifySocket {
 public:
  explicit NotifySocket(std::string address) : address_(std::move(address)) {
    sockaddr_un name{};
    name.sun_family = AF_UNIX;
    REQUIRE(address_.size() < sizeof name.sun_path);
    std::memcpy(name.sun_path, address_.data(), address_.size());
    if (address_.front() == '@') name.sun_path[0] = '\0';
    socket_ = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const auto size = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + address_.size());
    REQUIRE(bind(socket_, reinterpret_cast<const sockaddr*>(&name), size) == 0);
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  ~NotifySocket() { close(socket_); }

  [[nodiscard]] const std::string& address() const { return address_; }
  /// All messages so far, in order.
  const std::vector<std::string>& messages() {
    std::array<char, 4096> buffer{};
    for (;;) {
      const ssize_t size = recv(socket_, buffer.data(), buffer.size(), 0);
      if (size < 0) return messages_;
      messages_.emplace_back(buffer.data(), static_cast<std::size_t>(size));
    }
  }
  /// Number of messages with the words.
  std::size_t count(const std::string& words) {
    std::size_t found = 0;
    for (const std::string& message : messages()) found += message.find(words) != std::string::npos ? 1 : 0;
    return found;
  }
  /// Waits for the `times`-th message with the words; false if it does not arrive.
  bool await(const std::string& words, std::size_t times = 1) {
    return eventually([&] { return count(words) >= times; });
  }

 private:
  std::string address_;
  int socket_ = -1;
  std::vector<std::string> messages_;
};

}  // namespace nilio::tests
