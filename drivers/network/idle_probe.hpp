#pragma once

#include "nilio/core/time.hpp"

#include "drivers/common/socket.hpp"

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::drivers {

/// Finds out why a UDP source receives no packets: listens below the sockets (AF_PACKET) for UDP packets of
/// Velodyne's sizes to any address and port, for short periods and only while the source is idle. A listening
/// period counts only when the source stayed idle throughout. Needs CAP_NET_RAW; describe() reports a lack of
/// it.
///
/// The receive thread calls idle() and stop(), which never block, throw or allocate; any thread describe().
class IdleProbe {
 public:
  struct Timing {
    core::Duration patience{500'000'000};  ///< idle time before the first listening period
    core::Duration listening{1'000'000'000};
    core::Duration rest{9'000'000'000};  ///< between two listening periods
  };
  explicit IdleProbe(const Timing& timing) : timing_(timing) {}
  IdleProbe() : IdleProbe(Timing{}) {}

  /// Call when the source received nothing within its timeout; `now_ns` is CLOCK_MONOTONIC.
  void idle(std::int64_t now_ns);
  /// Call when a packet arrived.
  void stop();
  /// Result of the last listening period and its meaning for a source on `port`. Empty before the first.
  [[nodiscard]] std::string describe(std::uint16_t port) const;

  [[nodiscard]] bool is_listening() const { return socket_.is_open(); }

 private:
  /// Packets of one size from one address to another and a port.
  struct Stream {
    std::uint32_t source = 0;
    std::uint32_t destination = 0;
    std::uint16_t port = 0;
    std::uint16_t size = 0;
    friend bool operator==(const Stream&, const Stream&) = default;
  };
  struct Window {
    std::uint64_t count = 0;
    Stream stream;
  };
  /// Each member is consistent by itself; a reader during an update can see old and new streams mixed.
  struct Published {
    std::atomic<std::uint64_t> count{0};
    std::atomic<std::uint64_t> addresses{0};
    std::atomic<std::uint32_t> port_and_size{0};
  };
  static constexpr std::size_t kStreams = 6;

  void open();
  void drain();
  void note(const Stream& stream);
  void publish();

  const Timing timing_;
  FileDescriptor socket_;
  std::int64_t idle_since_ns_ = 0;
  std::int64_t opened_ns_ = 0;
  std::int64_t closed_ns_ = 0;
  std::array<Window, kStreams> window_{};
  std::array<Published, kStreams> published_{};
  std::atomic<std::uint64_t> listenings_{0};
  std::atomic<int> open_error_{0};
};

}  // namespace nilio::drivers
