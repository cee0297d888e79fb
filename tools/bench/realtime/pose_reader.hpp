#pragma once

#include "nilio/core/result.hpp"

#include "ipc/histogram.hpp"
#include "tools/common/child_process.hpp"

#include <cstdint>
#include <filesystem>
#include <string>

namespace nilio::tools::bench {

/// Figures of an independent reader.
struct ReaderFigures {
  std::uint64_t poses = 0;
  /// From the last packet's reception to the reader.
  ipc::LatencySummary packet_to_reader;
  /// It ran at SCHED_FIFO 30.
  bool is_fifo = false;
};

/// Figures from the lines that nilio-pose-reader printed. `host_id` of this machine (dds::read_host_id()).
ReaderFigures read_reader_lines(const std::string& text, const std::string& host_id);

/// nilio-pose-reader: a reader of another vendor (CycloneDDS) in a process of its own, on the loopback
/// interface. It ends with this object. One thread.
class PoseReader {
 public:
  /// Fails where the program is not beside this one.
  static core::Result<PoseReader> start(std::uint32_t domain, const std::filesystem::path& folder);

  /// It is matched with the publisher.
  [[nodiscard]] bool is_ready() const;
  /// Ends the reader.
  ReaderFigures stop();

 private:
  PoseReader(ChildProcess process, std::filesystem::path log)
      : process_(std::move(process)), log_(std::move(log)) {}

  ChildProcess process_;
  std::filesystem::path log_;
};

}  // namespace nilio::tools::bench
