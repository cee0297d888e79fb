#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace nilio::tools::mangle {

/// "AMOUNT@TIME": something of `amount_s` seconds at `at_s` seconds after the first packet or scan.
struct TimedFault {
  double amount_s = 0.0;
  double at_s = 0.0;
};

/// "COUNT/PERIOD": `count` consecutive packets, at random times `period_s` apart on average.
struct BurstLoss {
  unsigned count = 0;
  double period_s = 0.0;
};

/// Faults for a recording; the defaults change nothing. All times count from the first packet or scan.
struct Faults {
  // Of the packet stream.
  double loss = 0.0;  ///< share of packets
  std::optional<BurstLoss> burst;
  double duplicate = 0.0;               ///< share of packets that arrive twice
  double reorder = 0.0;                 ///< share of packets that change places with the next one
  std::vector<TimedFault> clock_steps;  ///< of the host's clock: all later receive times
  // Of the stream of packets or scans.
  std::vector<TimedFault> gaps;
  unsigned drop_scans = 0;  ///< every n-th scan is missing; 0 = none
  bool reverse = false;     ///< scans in the reverse order; not for packets
  // Of the returns.
  double ghosts = 0.0;               ///< share of returns with a random range
  double thin = 1.0;                 ///< share of returns that remain
  unsigned points = 0;               ///< returns a scan that remain, chosen at random; 0 = all
  unsigned rings = 0;                ///< rings that remain, evenly spaced; 0 = all
  double noise_m = 0.0;              ///< standard deviation of what is added to the ranges
  double field_of_view_deg = 360.0;  ///< centred ahead
  bool vegetation_only = false;      ///< returns of volumes that scatter in all directions
  std::uint64_t seed = 1;

  [[nodiscard]] bool changes_returns() const {
    return ghosts > 0.0 || thin < 1.0 || points > 0 || rings > 0 || noise_m > 0.0 ||
           field_of_view_deg < 360.0 || vegetation_only;
  }
  [[nodiscard]] bool changes_packets() const {
    return loss > 0.0 || burst || duplicate > 0.0 || reorder > 0.0 || !clock_steps.empty();
  }
  [[nodiscard]] bool changes_scans() const { return !gaps.empty() || drop_scans > 0 || reverse; }
};

/// Parses "0.5@30". The error says what was expected.
core::Result<TimedFault> parse_timed_fault(const std::string& text);
/// Parses "20/1.5".
core::Result<BurstLoss> parse_burst_loss(const std::string& text);

/// Refuses values outside their range, faults that exclude each other, and no fault at all.
core::Result<std::monostate> check_faults(const Faults& faults);

/// The options of the command that give these faults, for pages and messages: "--gap 0.5@30 --rings 8".
std::string to_options(const Faults& faults);

}  // namespace nilio::tools::mangle
