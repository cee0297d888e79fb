#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace nilio::drivers {

/// A file that grows by whole records: a record that cannot be written in full is truncated, so that a reader
/// never meets half a record within the file. It is created with its first record. One thread.
class RecordFile {
 public:
  RecordFile() = default;
  /// `header` is written before the first record.
  RecordFile(std::filesystem::path path, std::vector<std::uint8_t> header);
  RecordFile(RecordFile&& other) noexcept;
  RecordFile& operator=(RecordFile&& other) noexcept;
  RecordFile(const RecordFile&) = delete;
  RecordFile& operator=(const RecordFile&) = delete;
  ~RecordFile();

  /// Bytes that wait in memory at most while the disk does not accept data; hours of poses, a second of
  /// packets.
  static constexpr std::size_t kMaxPendingBytes = std::size_t{4} << 20U;

  /// Buffers the record for the next write_pending(). False, and the record is dropped, if too much waits.
  [[nodiscard]] bool append(std::span<const std::uint8_t> record);
  /// 0, or the errno of an incomplete write; unwritten records stay pending.
  int write_pending();
  /// 0 or errno.
  int sync();
  /// Removes a file without a record. 0 or errno.
  int close();
  /// Appends the pending records of a full file.
  void take_pending(RecordFile& other);
  /// Drops the pending records and returns their number.
  std::uint64_t drop_pending();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// Bytes on disk, and after the pending records are written.
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  [[nodiscard]] std::uint64_t bytes_with_pending() const;
  [[nodiscard]] std::size_t pending_bytes() const { return pending_.size(); }
  [[nodiscard]] std::uint64_t pending_records() const { return pending_sizes_.size(); }
  /// A partial record could not be truncated: no more writes are allowed.
  [[nodiscard]] bool is_spoiled() const { return spoiled_; }

 private:
  int open();
  /// Removes the written bytes from the front of `bytes`.
  int write_all(std::span<const std::uint8_t>& bytes);
  void keep_whole_records(std::size_t written);

  std::filesystem::path path_;
  std::vector<std::uint8_t> header_;
  std::vector<std::uint8_t> pending_;
  /// Size of each record in `pending_`.
  std::vector<std::uint32_t> pending_sizes_;
  std::uint64_t bytes_ = 0;
  int descriptor_ = -1;
  bool dirty_ = false;
  bool spoiled_ = false;
};

/// Whether a disk accepts data: limits the attempts, and reports the first failure and its end, once each.
/// One thread.
class DiskState {
 public:
  using Report = std::function<void(const std::string&)>;
  explicit DiskState(Report report) : report_(std::move(report)) {}

  /// False while the next attempt is not due. `now_ns`: CLOCK_MONOTONIC.
  [[nodiscard]] bool is_due(std::int64_t now_ns) const { return !blocked_ || now_ns >= next_attempt_ns_; }
  /// Makes the next attempt due.
  void retry_at_once() { next_attempt_ns_ = 0; }
  [[nodiscard]] bool is_blocked() const { return blocked_; }
  /// `lost`: records lost so far, for the difference that note_success() reports.
  void note_failure(const std::filesystem::path& file, int error, std::int64_t now_ns, std::uint64_t lost);
  void note_success(const std::filesystem::path& file, std::uint64_t lost);

 private:
  Report report_;
  bool blocked_ = false;
  std::int64_t next_attempt_ns_ = 0;
  std::uint64_t lost_before_ = 0;
};

}  // namespace nilio::drivers
