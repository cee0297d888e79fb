#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/packet.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace nilio::daemon {

/// Chooses whose packets are the sensor's, when several computers or sensors send to its ports.
///
/// A sensor sends hundreds of packets a second: the first address with kSteadyPackets data packets within
/// kWindow is selected, so that stray packets select nobody. Others are foreign from then on. Another address
/// replaces the selected one only after that was silent for kSilence (a replaced sensor, or a new address).
/// Decides by the packets' addresses and stamps alone, hence equally live and in a replay. One thread; does
/// not allocate.
class SenderSelection {
 public:
  enum class Verdict : std::uint8_t {
    kUndecided,  ///< nobody is selected yet
    kSelected,   ///< this packet selected its sender, for the first time or instead of a silent one
    kOwn,
    kForeign,
  };

  static constexpr std::uint32_t kSteadyPackets = 32;
  /// The slowest model sends 377 packets in this time.
  static constexpr core::Duration kWindow = core::Duration::from_milliseconds(500.0);
  static constexpr core::Duration kSilence = core::Duration::from_seconds(3.0);

  /// Evaluates a packet with the size of a data or position packet; only data packets select.
  Verdict examine(const drivers::Packet& packet);
  /// End of the input: selects the most frequent sender. False if there was no data packet.
  bool finish();

  /// Host byte order.
  [[nodiscard]] std::optional<std::uint32_t> sender() const { return sender_; }
  /// True once for each of the first kReports foreign addresses: call after kForeign.
  [[nodiscard]] bool is_first_of(std::uint32_t foreign_address);

 private:
  static constexpr std::size_t kCandidates = 8;
  static constexpr std::size_t kReports = 8;

  struct Candidate {
    std::uint32_t address = 0;
    core::Time window_start;
    core::Time last_heard;
    std::uint32_t in_window = 0;
    std::uint64_t packets = 0;
  };

  Candidate& candidate_of(const drivers::Packet& packet);
  void select(std::uint32_t address, core::Time stamp);

  std::optional<std::uint32_t> sender_;
  core::Time last_heard_;
  std::array<Candidate, kCandidates> candidates_{};
  std::size_t used_ = 0;
  std::array<std::uint32_t, kReports> reported_{};
  std::size_t reports_ = 0;
};

}  // namespace nilio::daemon
