#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::record {

/// A file that grows by whole records: what cannot be written in full is taken back, so that a reader never
/// meets half a record with others behind it. It comes into being with its first record. One thread.
class RecordFile {
 public:
  RecordFile() = default;
  /// `header` comes before the first record.
  RecordFile(std::filesystem::path path, std::vector<std::uint8_t> header);
  RecordFile(RecordFile&& other) noexcept;
  RecordFile& operator=(RecordFile&& other) noexcept;
  RecordFile(const RecordFile&) = delete;
  RecordFile& operator=(const RecordFile&) = delete;
  ~RecordFile();

  /// Keeps the record for the next write_pending().
  void append(std::span<const std::uint8_t> record);
  /// 0, or the reason why not all was written: what found room is in the file, what did not stays pending.
  int write_pending();
  /// 0 or the reason.
  int sync();
  /// Takes away a file without a record. 0 or the reason.
  int close();
  /// Takes the pending records of a file that takes no more.
  void take_pending(RecordFile& other);
  /// Forgets the pending records; how many they were.
  std::uint64_t drop_pending();

  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// On disk, and on disk when all that is pending is written.
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  [[nodiscard]] std::uint64_t bytes_with_pending() const;
  [[nodiscard]] std::size_t pending_bytes() const { return pending_.size(); }
  [[nodiscard]] std::uint64_t pending_records() const { return pending_sizes_.size(); }
  /// A torn record could not be taken back: nothing more may be written.
  [[nodiscard]] bool is_spoiled() const { return spoiled_; }

 private:
  int open();
  /// Takes what was written off the front of `bytes`.
  int write_all(std::span<const std::uint8_t>& bytes);
  void keep_whole_records(std::size_t written);

  std::filesystem::path path_;
  std::vector<std::uint8_t> header_;
  std::vector<std::uint8_t> pending_;
  /// Of each record in `pending_`.
  std::vector<std::uint32_t> pending_sizes_;
  std::uint64_t bytes_ = 0;
  int descriptor_ = -1;
  bool dirty_ = false;
  bool spoiled_ = false;
};

}  // namespace nilio::tools::record
