#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "tools/record/file.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace nilio::tools::record {

/// A recording is a series of parts; part 12 is lidar_0012.pcap and can_0012.log.
enum class RecordStream : std::uint8_t { kLidar, kCan };
inline constexpr std::size_t kRecordStreams = 2;

struct RecordLimits {
  /// A part is closed before it would grow beyond this; bytes of both files.
  std::uint64_t rotate_bytes = 1'000'000'000;
  /// A part is closed at this age; zero = never.
  core::Duration rotate_after{};
  /// Newest parts kept in the folder, those of earlier recordings among them; zero = all.
  std::uint64_t keep = 0;
};

/// Written by one thread, read by any.
struct RecordCounters {
  std::array<std::atomic<std::uint64_t>, kRecordStreams> written{};  ///< records handed to the kernel
  std::array<std::atomic<std::uint64_t>, kRecordStreams> lost{};     ///< found no room on the disk
  std::atomic<std::uint64_t> bytes{0};
  std::atomic<std::uint64_t> files{0};
  std::atomic<std::uint64_t> deleted{0};  ///< files taken away to keep no more parts than wanted
  std::atomic<std::uint64_t> part{0};     ///< number of the part being written
  std::atomic<bool> blocked{false};       ///< nothing can be written at the moment
};

/// Names of part `number`.
std::string record_file_name(RecordStream stream, std::uint64_t number);

/// Writes records into the parts of a recording. Never overwrites: numbers go on after the highest in the
/// folder. While the disk takes nothing, 4 MB per stream are held for it and the rest is lost and counted;
/// what is in the files is whole records at any time. One thread; `report` is called from it with a line for
/// a person.
class RecordParts {
 public:
  using Report = std::function<void(const std::string&)>;

  /// Makes the folder if it is missing. Fails when it cannot be made or written.
  static core::Result<RecordParts> create(const std::filesystem::path& folder, const RecordLimits& limits,
                                          RecordCounters& counters, Report report);

  /// `now_ns`: CLOCK_MONOTONIC.
  void append(RecordStream stream, std::span<const std::uint8_t> record, std::int64_t now_ns);
  /// Hands everything to the kernel, from where it survives the death of this process.
  void flush(std::int64_t now_ns);
  /// Makes what was flushed survive the loss of power; takes as long as the disk does.
  void sync();
  /// Flushes, syncs and closes; what still finds no room is lost and counted.
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
  void note_failure(const RecordFile& file, int error, std::int64_t now_ns);
  void note_success();
  void delete_old_parts();
  [[nodiscard]] std::uint64_t lost_total() const;

  std::filesystem::path folder_;
  RecordLimits limits_;
  RecordCounters* counters_;
  Report report_;
  std::array<RecordFile, kRecordStreams> files_;
  std::int64_t part_begin_ns_ = 0;
  std::int64_t next_attempt_ns_ = 0;
  std::uint64_t lost_before_ = 0;
};

}  // namespace nilio::tools::record
