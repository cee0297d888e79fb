#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Accepts frames whose identifier equals `id` in the bits of `mask`.
struct CanFilter {
  std::uint32_t id = 0;
  bool extended = false;
  std::uint32_t mask = 0x1FFFFFFF;
};

struct SocketCanConfig {
  std::string interface_name = "can0";
  /// Empty = all frames; the kernel takes at most 512. Error frames are always received.
  std::vector<CanFilter> filters{};
  /// The kernel accounts 768 bytes per frame: 2731 frames, 0.9 s of a full bus.
  int receive_buffer_bytes = 1024 * 1024;
  /// Succeeds also while the interface is missing, and opens it when it appears.
  bool wait_for_interface = false;
};

/// Live CAN and CAN FD: recvmmsg, kernel time stamps (SO_TIMESTAMPNS) and drop counter (SO_RXQ_OVFL), error
/// frames as CanFrame::error with their class bits as id. Frames sent by this computer are received, too. An
/// interface that goes down or is unplugged does not end the source: it is counted and opened again when it
/// is back. Errors name the interface, the reason and the command that helps.
///
/// status() queries the interface's driver over rtnetlink, which takes some 100 us and at most 0.3 s: not for
/// real-time threads.
core::Result<std::unique_ptr<FrameSource>> open_socketcan(const SocketCanConfig& config);

enum class CanSendResult {
  kSent,
  kQueueFull,  ///< the interface's send queue is full; try again
  kDown,       ///< the interface is down or gone
  kRefused,    ///< the kernel does not accept the frame (CAN FD on a classic interface)
};

/// Sends frames, for playing recordings. One thread.
class CanSender {
 public:
  /// Fails as open_socketcan().
  static core::Result<CanSender> open(const std::string& interface_name);
  CanSender(CanSender&& other) noexcept;
  CanSender& operator=(CanSender&&) = delete;
  CanSender(const CanSender&) = delete;
  CanSender& operator=(const CanSender&) = delete;
  ~CanSender();

  /// Does not wait. Error frames cannot be sent and are refused.
  CanSendResult send(const CanFrame& frame);

 private:
  explicit CanSender(int descriptor) : descriptor_(descriptor) {}
  int descriptor_;
};

}  // namespace nilio::drivers
