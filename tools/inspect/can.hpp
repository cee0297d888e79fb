#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/can/dbc/dbc.hpp"

#include "tools/common/statistics.hpp"
#include "tools/inspect/imu.hpp"

#include <cstdint>
#include <map>
#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// One signal of a DBC, decoded from every frame that carries it.
struct CanSignalFindings {
  std::string name;
  std::string unit;
  Spread physical;
};

/// Frames of one identifier on one interface.
struct CanMessageFindings {
  std::string interface_name;
  std::uint32_t id = 0;
  bool extended = false;
  std::uint64_t frames = 0;
  std::uint8_t shortest = 0;
  std::uint8_t longest = 0;
  /// Between consecutive frames: rate, jitter and longest gap.
  Spread interval_s;
  /// Intervals of more than twice the mean.
  std::uint64_t gaps = 0;
  /// From the DBC; empty for a message that it does not contain.
  std::string name;
  std::vector<CanSignalFindings> signals;

  [[nodiscard]] double rate_hz() const;
};

/// Contents of one candump log.
struct CanFindings {
  std::string path;
  std::uint64_t frames = 0;
  std::uint64_t error_frames = 0;
  std::uint64_t remote_frames = 0;
  std::uint64_t fd_frames = 0;
  std::uint64_t broken_lines = 0;
  std::uint64_t first_broken_line = 0;
  /// Frames with an earlier stamp than the preceding one.
  std::uint64_t out_of_order = 0;
  /// Stamps of the earliest and the latest frame.
  core::Time first;
  core::Time last;
  std::map<std::string, std::uint64_t> interfaces;
  /// By interface and identifier.
  std::vector<CanMessageFindings> messages;
  /// Frames of identifiers beyond the maximum number of separate ones.
  std::uint64_t further_frames = 0;
  /// Presets whose messages are present, complete and plausible or not, in descending order of samples.
  std::vector<ImuFindings> imus;

  [[nodiscard]] bool usable() const { return frames > error_frames; }
  [[nodiscard]] double duration_s() const { return (last - first).seconds(); }
  /// The IMU to use; null if there is none.
  [[nodiscard]] const ImuFindings* imu() const;
  /// False for stamps relative to the start of the log, which cannot be compared with a capture's.
  [[nodiscard]] bool has_wall_clock() const;
};

/// Reads the log once, in bounded memory. With a DBC (may be null) messages are named and their signals
/// decoded. Fails when it cannot be read.
core::Result<CanFindings> inspect_can_log(const std::string& path, const drivers::DbcDatabase* dbc = nullptr);

/// One line for a log that is not usable: its contents and the remedy.
std::string why_unusable(const CanFindings& can);

}  // namespace nilio::tools::inspect
