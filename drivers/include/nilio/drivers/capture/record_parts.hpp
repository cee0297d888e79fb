#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/capture/record_file.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Streams of a recording, which is a series of parts; part 12 is lidar_0012.pcap and can_0012.log.
enum class RecordStream : std::uint8_t { kLidar, kCan };
inline constexpr std::size_t kRecordStreams = 2;

struct RecordLimits {
  /// Maximum size of a part; bytes of both files.
  std::uint64_t rotate_bytes = 1'000'000'000;
  /// Maximum age of a part; zero = unlimited.
  core::Duration rotate_after{};
  /// Number of newest parts kept in the folder, including those of earlier recordings; zero = all.
  std::uint64_t keep = 0;
};

/// Written by one thread, read by any.
struct RecordCounters {
  std::array<std::atomic<std::uint64_t>, kRecordStreams> written{};  ///< records written to the kernel
  std::array<std::atomic<std::uint64_t>, kRecordStreams> lost{};     ///< dropped because the disk was full
  std::atomic<std::uint64_t> bytes{0};
  std::atomic<std::uint64_t> files{0};
  std::atomic<std::uint64_t> deleted{0};  ///< files deleted to keep the number of parts
  std::atomic<std::uint64_t> part{0};     ///< number of the part being written
  std::atomic<bool> blocked{false};       ///< the disk accepts no data at present
};

/// File name of part `number`.
std::string record_file_name(RecordStream stream, std::uint64_t number);

/// Writes records into the parts of a recording. Never overwrites: numbers continue after the highest in the
/// folder. While the disk is blocked, 4 MB per stream are buffered and the rest is dropped and counted; the
/// files contain whole records at any time. One thread, which also calls `report` with a line for people.
class RecordParts {
 public:
  using Report = DiskState::Report;

  /// Creates the folder if it is missing. Fails when it cannot be created or written.
  static core::Result<RecordParts> create(const std::filesystem::path& folder, const RecordLimits& limits,
                                          RecordCounters& counters, Report report);

  /// `now_ns`: CLOCK_MONOTONIC.
  void append(RecordStream stream, std::span<const std::uint8_t> record, std::int64_t now_ns);
  /// Writes everything to the kernel, so that it survives the death of this process.
  void flush(std::int64_t now_ns);
  /// Syncs flushed data to the disk, so that they survive a loss of power; blocks as long as the disk does.
  void sync();
  /// Flushes, syncs and closes; records that do not fit are dropped and counted.
  void close(std::int64_t now_ns);

 private:
  RecordParts(std::filesystem::path folder, const RecordLimits& limits, RecordCounters& counters,
              Report report, std::uint64_t number);

  [[nodiscard]] std::uint64_t part_bytes() const;
  [[nodiscard]] bool is_part_full(std::size_t more, std::int64_t now_ns) const;
  void begin_part(std::uint64_t number);
  void next_part(std::int64_t now_ns);
  int write_pending(std::size_t index);
  void close_file(RecordFile& file);
  void delete_old_parts();
  [[nodiscard]] std::uint64_t lost_total() const;

  std::filesystem::path folder_;
  RecordLimits limits_;
  RecordCounters* counters_;
  Report report_;
  DiskState disk_;
  std::array<RecordFile, kRecordStreams> files_;
  std::int64_t part_begin_ns_ = 0;
};

}  // namespace nilio::drivers
