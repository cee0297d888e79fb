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
  kIdle,    ///< nothing arrived within the timeout; a live source continues
  kEnd,     ///< end of a recording
  kFailed,  ///< the source is lost; status() gives the reason and the remedy
};

struct SourceRead {
  SourceState state = SourceState::kIdle;
  std::size_t count = 0;
};

/// Counts of a source so far; stats() returns a copy.
struct SourceStats {
  std::uint64_t delivered = 0;       ///< packets or frames delivered
  std::uint64_t kernel_dropped = 0;  ///< lost in the socket buffer, by the kernel's count
  std::uint64_t malformed = 0;       ///< unreadable records (truncated, bad line, wrong length)
  std::uint64_t other = 0;           ///< well-formed but not wanted (other port, other sender)
};

/// Source of packets or frames: a live socket or a recorded file, with the same interface. One thread calls
/// read(); stats() and status() may be called from another.
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
  /// One line for the user: the source and its counts; after kFailed or an unusual end also the reason and
  /// the remedy.
  [[nodiscard]] virtual std::string status() const = 0;
};

using PacketSource = Source<Packet>;
using FrameSource = Source<CanFrame>;

}  // namespace nilio::drivers
