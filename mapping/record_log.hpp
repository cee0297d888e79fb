#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <variant>
#include <vector>

#include "mapping/bytes.hpp"

namespace nilio::mapping {

/// Record of a log file, as it is read back.
struct LogRecord {
  std::uint16_t type = 0;
  std::span<const std::uint8_t> payload;
};

/// Content of a log file up to its first damaged record.
struct LogContent {
  Bytes bytes;  ///< of the file; the records point into them
  std::vector<LogRecord> records;
  std::size_t valid_bytes = 0;  ///< bytes of the intact records
};

/// Reads a whole log. A last record that was written partly, or is damaged, ends it.
core::Result<LogContent> read_log(const std::filesystem::path& path);

/// Append-only file of records: u32 length of the payload, u16 type, u16 flags, u64 number, payload, u32
/// CRC-32C of all before. One thread.
class RecordLog {
 public:
  /// Opens the file, creates it if needed, and cuts it to `valid_bytes`, which hold `records`.
  static core::Result<RecordLog> open(const std::filesystem::path& path, std::size_t valid_bytes = 0,
                                      std::uint64_t records = 0);
  RecordLog(RecordLog&& other) noexcept;
  RecordLog& operator=(RecordLog&& other) noexcept;
  RecordLog(const RecordLog&) = delete;
  RecordLog& operator=(const RecordLog&) = delete;
  ~RecordLog();

  /// Written by one call: a process that is killed leaves a whole record or a damaged last one. `sync`: wait
  /// until the disk has it.
  core::Result<std::monostate> append(std::uint16_t type, std::span<const std::uint8_t> payload, bool sync);
  /// Locks the file against other writers; false if another one has it.
  [[nodiscard]] bool lock();

 private:
  RecordLog(std::filesystem::path path, int file_descriptor, std::uint64_t records)
      : path_(std::move(path)), file_descriptor_(file_descriptor), next_(records) {}

  std::filesystem::path path_;
  int file_descriptor_ = -1;
  std::uint64_t next_ = 0;
};

/// Replaces a file as a whole and waits until the disk has it: readers see the old content or the new one.
core::Result<std::monostate> replace_file(const std::filesystem::path& path,
                                          std::span<const std::uint8_t> bytes);
/// Bytes of a file.
core::Result<Bytes> read_bytes(const std::filesystem::path& path);

}  // namespace nilio::mapping
