#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture/record_parts.hpp"
#include "nilio/drivers/packet.hpp"

#include "daemon/odometry/decision_log.hpp"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Black box of a run: the packets with the receive stamps that the odometry used, CAN frames, decisions and
/// configuration. `niliod --decisions FOLDER` repeats the run from it, bit by bit. One thread.
class RunRecorder {
 public:
  /// Creates the folder with its nilio.yaml. Fails where a recording exists already: its decisions would not
  /// match. `report` takes lines about the disk.
  static core::Result<std::unique_ptr<RunRecorder>> create(const std::filesystem::path& folder,
                                                           const std::string& effective_config,
                                                           const drivers::DiskState::Report& report);

  /// First line of decisions.jsonl; call before the first decision.
  void open_decisions(const std::string& header);
  /// `now_ns`: CLOCK_MONOTONIC.
  void add(const drivers::Packet& packet, std::int64_t now_ns);
  void add(const drivers::CanFrame& frame, const std::string& interface_name, std::int64_t now_ns);
  void add(const ScanDecision& decision);
  /// Gives the kernel everything added, so that it survives the end of this process.
  void flush(std::int64_t now_ns);
  void close(std::int64_t now_ns);
  /// Packets, frames and decisions that the disk did not accept in time; the run cannot be repeated from the
  /// first of them on.
  [[nodiscard]] std::uint64_t lost() const;
  [[nodiscard]] const drivers::RecordCounters& counters() const { return counters_; }

 private:
  explicit RunRecorder(const drivers::DiskState::Report& report) : disk_(report) {}

  drivers::RecordCounters counters_;
  std::unique_ptr<drivers::RecordParts> parts_;
  std::filesystem::path folder_;
  drivers::DiskState disk_;
  drivers::RecordFile decisions_;
  std::uint64_t lost_decisions_ = 0;
  std::uint64_t unrecordable_ = 0;
  std::vector<std::uint8_t> record_;
};

}  // namespace nilio::daemon
