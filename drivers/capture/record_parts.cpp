#include "nilio/drivers/capture/record_parts.hpp"

#include "nilio/drivers/capture/pcap.hpp"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <optional>
#include <set>
#include <string_view>
#include <unistd.h>

namespace nilio::drivers {

namespace {

namespace fs = std::filesystem;
using core::Error;

/// Pending bytes that start a write.
constexpr std::size_t kWriteBytes = std::size_t{1} << 20;
/// Files with larger numbers are not from this program.
constexpr std::uint64_t kLargestNumber = 999'999'999;

std::string_view prefix_of(RecordStream stream) { return stream == RecordStream::kLidar ? "lidar_" : "can_"; }
std::string_view extension_of(RecordStream stream) {
  return stream == RecordStream::kLidar ? ".pcap" : ".log";
}

std::optional<std::uint64_t> part_number(const std::string& name, RecordStream stream) {
  const std::string_view prefix = prefix_of(stream);
  const std::string_view extension = extension_of(stream);
  if (name.size() <= prefix.size() + extension.size() || !name.starts_with(prefix) ||
      !name.ends_with(extension))
    return std::nullopt;
  const char* const end = name.data() + name.size() - extension.size();
  std::uint64_t number = 0;
  const auto parsed = std::from_chars(name.data() + prefix.size(), end, number);
  if (parsed.ec != std::errc{} || parsed.ptr != end || number > kLargestNumber) return std::nullopt;
  return number;
}

/// Numbers of the parts in the folder.
std::set<std::uint64_t> find_parts(const fs::path& folder) {
  std::set<std::uint64_t> numbers;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    for (const RecordStream stream : {RecordStream::kLidar, RecordStream::kCan}) {
      if (const auto number = part_number(entry->path().filename().string(), stream)) numbers.insert(*number);
    }
  }
  return numbers;
}

}  // namespace

std::string record_file_name(RecordStream stream, std::uint64_t number) {
  std::array<char, 24> digits{};
  std::snprintf(digits.data(), digits.size(), "%04llu", static_cast<unsigned long long>(number));
  return std::string(prefix_of(stream)) + digits.data() + std::string(extension_of(stream));
}

core::Result<RecordParts> RecordParts::create(const fs::path& folder, const RecordLimits& limits,
                                              RecordCounters& counters, Report report) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error)
    return Error{folder.string() + ": could not be created (" + error.message() +
                 ") - check the path and its permissions"};
  if (access(folder.c_str(), W_OK | X_OK) != 0)
    return Error{folder.string() + ": cannot be written (" + std::strerror(errno) +
                 "); check the folder's permissions"};
  const std::set<std::uint64_t> numbers = find_parts(folder);
  return RecordParts(folder, limits, counters, std::move(report),
                     numbers.empty() ? 1 : *numbers.rbegin() + 1);
}

RecordParts::RecordParts(fs::path folder, const RecordLimits& limits, RecordCounters& counters, Report report,
                         std::uint64_t number)
    : folder_(std::move(folder)),
      limits_(limits),
      counters_(&counters),
      report_(report),
      disk_(std::move(report)) {
  begin_part(number);
}

void RecordParts::begin_part(std::uint64_t number) {
  std::vector<std::uint8_t> header;
  append_pcap_header(header);
  files_[0] = RecordFile(folder_ / record_file_name(RecordStream::kLidar, number), std::move(header));
  files_[1] = RecordFile(folder_ / record_file_name(RecordStream::kCan, number), {});
  counters_->part.store(number);
  part_begin_ns_ = 0;
}

std::uint64_t RecordParts::part_bytes() const {
  return files_[0].bytes_with_pending() + files_[1].bytes_with_pending();
}

bool RecordParts::is_part_full(std::size_t more, std::int64_t now_ns) const {
  const std::uint64_t bytes = part_bytes();
  if (bytes == 0 || counters_->blocked.load()) return false;
  return bytes + more > limits_.rotate_bytes ||
         (limits_.rotate_after.ns > 0 && now_ns - part_begin_ns_ >= limits_.rotate_after.ns);
}

void RecordParts::append(RecordStream stream, std::span<const std::uint8_t> record, std::int64_t now_ns) {
  const auto index = static_cast<std::size_t>(stream);
  if (is_part_full(record.size(), now_ns)) {
    flush(now_ns);
    if (!counters_->blocked.load()) next_part(now_ns);
  }
  if (part_bytes() == 0) part_begin_ns_ = now_ns;
  if (!files_[index].append(record)) {
    counters_->lost[index].fetch_add(1);
    return;
  }
  if (files_[index].pending_bytes() >= kWriteBytes) flush(now_ns);
}

void RecordParts::flush(std::int64_t now_ns) {
  if (!disk_.is_due(now_ns)) return;
  for (std::size_t i = 0; i < kRecordStreams; ++i) {
    int error = write_pending(i);
    // A file at its size limit is full, not the disk.
    while ((error == EFBIG && files_[i].bytes() > 0) || files_[i].is_spoiled() || error == EEXIST) {
      next_part(now_ns);
      error = write_pending(i);
    }
    if (error != 0) {
      disk_.note_failure(files_[i].path(), error, now_ns, lost_total());
      break;
    }
    if (i + 1 == kRecordStreams) disk_.note_success(files_[0].path(), lost_total());
  }
  counters_->blocked.store(disk_.is_blocked());
}

/// 0, or the errno of an incomplete write.
int RecordParts::write_pending(std::size_t index) {
  RecordFile& file = files_[index];
  const std::uint64_t before = file.bytes();
  const std::uint64_t records = file.pending_records();
  const int error = file.write_pending();
  counters_->bytes.fetch_add(file.bytes() - before);
  counters_->written[index].fetch_add(records - file.pending_records());
  if (before == 0 && file.bytes() > 0) {
    counters_->files.fetch_add(1);
    delete_old_parts();
  }
  return error;
}

/// Closes the part; its pending records move to the next.
void RecordParts::next_part(std::int64_t now_ns) {
  std::array<RecordFile, kRecordStreams> old = std::exchange(files_, {});
  const std::set<std::uint64_t> numbers = find_parts(folder_);
  // Another program may record into the same folder.
  begin_part(std::max(counters_->part.load(), numbers.empty() ? 0 : *numbers.rbegin()) + 1);
  for (std::size_t i = 0; i < kRecordStreams; ++i) {
    files_[i].take_pending(old[i]);
    close_file(old[i]);
  }
  part_begin_ns_ = now_ns;
}

void RecordParts::close_file(RecordFile& file) {
  if (const int error = file.close(); error != 0)
    report_(file.path().string() + ": closing failed (" + std::strerror(error) +
            "): its end may be missing - check the disk");
}

void RecordParts::delete_old_parts() {
  if (limits_.keep == 0) return;
  std::set<std::uint64_t> numbers = find_parts(folder_);
  while (numbers.size() > limits_.keep) {
    for (const RecordStream stream : {RecordStream::kLidar, RecordStream::kCan}) {
      std::error_code error;
      const fs::path path = folder_ / record_file_name(stream, *numbers.begin());
      if (fs::remove(path, error)) counters_->deleted.fetch_add(1);
      if (error)
        report_(path.string() + ": could not be deleted (" + error.message() +
                "); check the folder's permissions");
    }
    numbers.erase(numbers.begin());
  }
}

std::uint64_t RecordParts::lost_total() const {
  return counters_->lost[0].load() + counters_->lost[1].load();
}

void RecordParts::sync() {
  for (RecordFile& file : files_) {
    if (const int error = file.sync(); error != 0)
      report_(file.path().string() + ": sync failed (" + std::strerror(error) + "); check the disk");
  }
}

void RecordParts::close(std::int64_t now_ns) {
  disk_.retry_at_once();
  flush(now_ns);
  for (std::size_t i = 0; i < kRecordStreams; ++i) {
    counters_->lost[i].fetch_add(files_[i].drop_pending());
    close_file(files_[i]);
  }
}

}  // namespace nilio::drivers
