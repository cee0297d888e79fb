#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <cstdint>

namespace nilio::tools::bench {

struct ReceiveTrialOptions {
  /// Packets per second; 6,030 is the rate of a VLS-128.
  double rate_hz = 6030.0;
  std::uint64_t packets = 30'000;
  /// The receive thread does not read for `stall_s` in every `stall_period_s`; 0 = no stalls.
  double stall_s = 0.0;
  double stall_period_s = 1.0;
  int receive_buffer_bytes = 8 * 1024 * 1024;
  std::size_t ring_slots = 8192;
};

struct ReceiveTrialResult {
  std::uint64_t sent = 0;
  std::uint64_t received = 0;
  std::uint64_t missing = 0;  ///< numbers that were sent but did not come out of the ring
  std::uint64_t wrong = 0;    ///< numbers that came more than once or were never sent
  std::uint64_t kernel_dropped = 0;
  std::uint64_t ring_dropped = 0;
  std::uint64_t stalls = 0;
  double cpu_share = 0.0;  ///< CPU time of the receive thread per wall time
  double mean_batch = 0.0;
  std::size_t largest_batch = 0;

  /// True when every loss is in exactly one counter.
  [[nodiscard]] bool is_accounted() const {
    return wrong == 0 && received + missing == sent && missing == kernel_dropped + ring_dropped;
  }
};

/// Sends numbered packets of a VLS-128's format through the loopback interface to open_udp() and
/// receive_packets(), as niliod runs them, and compares the packets of the ring with the counters. Takes as
/// long as the packets need at the rate. Fails without a socket, or when no more packets arrive.
core::Result<ReceiveTrialResult> try_receiving(const ReceiveTrialOptions& options);

}  // namespace nilio::tools::bench
