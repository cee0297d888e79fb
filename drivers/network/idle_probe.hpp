#pragma once

#include "nilio/core/time.hpp"

#include "drivers/common/file_descriptor.hpp"

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::drivers {

/// Why does nothing arrive? Listens below the sockets (AF_PACKET) for UDP packets of Velodyne's sizes to any
/// address and port, for short whiles and only as long as the source is idle. What it saw counts only when
/// the source stayed idle for the whole while. Needs CAP_NET_RAW, and says so.
///
/// The receive thread calls idle() and stop(), which never block, throw or allocate; any thread describe().
class IdleProbe {
 public:
  struct Timing {
    core::Duration patience{1'000'000'000};  ///< idle for so long before the first listening
    core::Duration listening{1'000'000'000};
    core::Duration rest{9'000'000'000};  ///< between one listening and the next
  };
  explicit IdleProbe(const Timing& timing) : timing_(timing) {}
  IdleProbe() : IdleProbe(Timing{}) {}

  /// The source waited in vain; `now_ns` is CLOCK_MONOTONIC.
  void idle(std::int64_t now_ns);
  /// Something arrived.
  void stop();
  /// What the last listening saw, and what that means for a source that listens on `port`. Empty as long as
  /// there was none.
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
  /// Each part whole by itself; a reader in the middle of an update sees old and new streams mixed.
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
