#pragma once

#include "nilio/drivers/packet.hpp"

#include "tools/common/system.hpp"

#include <arpa/inet.h>
#include <atomic>
#include <cstdint>
#include <netinet/in.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

namespace nilio::tools::bench {

/// Sends a data packet to a port of this computer 20 times a second from 127.0.0.2, as a second sensor or a
/// stray player in the vehicle's network would. Runs from construction to destruction.
class ForeignSender {
 public:
  static constexpr core::Duration kPeriod = core::Duration::from_milliseconds(50.0);

  ForeignSender(const drivers::Packet& packet, std::uint16_t port)
      : packet_(packet), port_(port), thread_([this] { run(); }) {}
  ForeignSender(const ForeignSender&) = delete;
  ForeignSender& operator=(const ForeignSender&) = delete;
  ~ForeignSender() {
    stop_.store(true);
    thread_.join();
  }

  [[nodiscard]] std::uint64_t sent() const { return sent_.load(); }

 private:
  void run() {
    const auto address = [](std::uint32_t host, std::uint16_t port) {
      sockaddr_in result{};
      result.sin_family = AF_INET;
      result.sin_port = htons(port);
      result.sin_addr.s_addr = htonl(host);
      return result;
    };
    const sockaddr_in from = address(INADDR_LOOPBACK + 1, 0);
    const sockaddr_in to = address(INADDR_LOOPBACK, port_);
    const int descriptor = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const bool bound = bind(descriptor, reinterpret_cast<const sockaddr*>(&from), sizeof from) == 0;
    while (bound && !stop_.load()) {
      const ssize_t sent = sendto(descriptor, packet_.data.data(), packet_.size, 0,
                                  reinterpret_cast<const sockaddr*>(&to), sizeof to);
      if (sent == packet_.size) sent_.fetch_add(1);
      sleep_for(kPeriod);
    }
    close(descriptor);
  }

  const drivers::Packet packet_;
  const std::uint16_t port_;
  std::atomic<std::uint64_t> sent_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace nilio::tools::bench
