#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

namespace nilio::drivers {

enum class SourceState {
  kData,    ///< `count` slots were filled
  kIdle,    ///< nothing arrived within the timeout; a live source goes on
  kEnd,     ///< a recording is at its end
  kFailed,  ///< the source is gone; status() says what, where and what to do
};

struct SourceRead {
  SourceState state = SourceState::kIdle;
  std::size_t count = 0;
};

/// What a source has seen so far. Read by the supervisor while the receive thread writes: copies are taken by
/// stats().
struct SourceStats {
  std::uint64_t delivered = 0;       ///< packets or frames handed on
  std::uint64_t kernel_dropped = 0;  ///< lost in the socket buffer, as the kernel counts
  std::uint64_t malformed = 0;       ///< records that could not be read (truncated, bad line, wrong length)
  std::uint64_t other = 0;           ///< well-formed but not for us (other port, other sender)
};

/// Where measurements enter. A live socket and a recorded file are two implementations; nothing above can
/// tell which it has. One thread calls read(); stats() and status() may be called from another.
template <class Slot>
class Source {
 public:
  Source() = default;
  Source(const Source&) = delete;
  Source& operator=(const Source&) = delete;
  virtual ~Source() = default;

  /// Fills the front of `slots` in order of arrival and returns at once when at least one is filled;
  /// otherwise waits up to `timeout`. Never throws, does not allocate after the first call.
  virtual SourceRead read(std::span<Slot> slots, core::Duration timeout) = 0;
  [[nodiscard]] virtual SourceStats stats() const = 0;
  /// One line for a person: what the source is, and after kFailed or an unusual end what was seen and what to
  /// do.
  [[nodiscard]] virtual std::string status() const = 0;
};

using PacketSource = Source<Packet>;
using FrameSource = Source<CanFrame>;

}  // namespace nilio::drivers
