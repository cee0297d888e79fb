#include "nilio/drivers/capture/record_file.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <unistd.h>
#include <utility>

namespace nilio::drivers {

namespace {

constexpr std::int64_t kRetryPeriodNs = 500'000'000;

std::string failure_advice(int error) {
  if (error == ENOSPC || error == EDQUOT)
    return "free space there; writing continues when there is space, data until then are dropped";
  if (error == EFBIG) return "raise the limit on the size of files ('ulimit -f')";
  return "check the disk; writing is retried until the end of the run";
}

}  // namespace

RecordFile::RecordFile(std::filesystem::path path, std::vector<std::uint8_t> header)
    : path_(std::move(path)), header_(std::move(header)) {}

RecordFile::RecordFile(RecordFile&& other) noexcept { *this = std::move(other); }

RecordFile& RecordFile::operator=(RecordFile&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(header_, other.header_);
  std::swap(pending_, other.pending_);
  std::swap(pending_sizes_, other.pending_sizes_);
  std::swap(bytes_, other.bytes_);
  std::swap(descriptor_, other.descriptor_);
  std::swap(dirty_, other.dirty_);
  std::swap(spoiled_, other.spoiled_);
  return *this;
}

RecordFile::~RecordFile() { close(); }

std::uint64_t RecordFile::bytes_with_pending() const {
  if (pending_.empty()) return bytes_;
  return bytes_ + pending_.size() + (bytes_ == 0 ? header_.size() : 0);
}

bool RecordFile::append(std::span<const std::uint8_t> record) {
  if (pending_.size() + record.size() > kMaxPendingBytes) return false;
  pending_.insert(pending_.end(), record.begin(), record.end());
  pending_sizes_.push_back(static_cast<std::uint32_t>(record.size()));
  return true;
}

int RecordFile::open() {
  descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor_ < 0) return errno;
  // The directory entry has to survive a loss of power, too.
  const int folder = ::open(path_.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    fsync(folder);
    ::close(folder);
  }
  return 0;
}

int RecordFile::write_all(std::span<const std::uint8_t>& bytes) {
  while (!bytes.empty()) {
    const ssize_t written = ::write(descriptor_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return written < 0 ? errno : ENOSPC;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return 0;
}

int RecordFile::write_pending() {
  if (pending_.empty()) return 0;
  if (spoiled_) return EIO;
  if (descriptor_ < 0) {
    if (const int error = open(); error != 0) return error;
  }
  std::span<const std::uint8_t> header = bytes_ == 0 ? header_ : std::span<const std::uint8_t>();
  const std::uint64_t header_size = header.size();
  std::span<const std::uint8_t> records = pending_;
  int error = write_all(header);
  if (error == 0) error = write_all(records);
  const std::uint64_t before = bytes_;
  keep_whole_records(pending_.size() - records.size());
  if (bytes_ > before) bytes_ += header_size;
  if (error != 0) {
    const auto whole = static_cast<off_t>(bytes_);
    spoiled_ = ftruncate(descriptor_, whole) != 0 || lseek(descriptor_, whole, SEEK_SET) != whole;
  }
  return error;
}

/// Keeps the whole records of `written` bytes; the rest stays pending.
void RecordFile::keep_whole_records(std::size_t written) {
  std::size_t kept = 0;
  std::size_t records = 0;
  while (records < pending_sizes_.size() && kept + pending_sizes_[records] <= written)
    kept += pending_sizes_[records++];
  pending_.erase(pending_.begin(), pending_.begin() + static_cast<std::ptrdiff_t>(kept));
  pending_sizes_.erase(pending_sizes_.begin(), pending_sizes_.begin() + static_cast<std::ptrdiff_t>(records));
  bytes_ += kept;
  dirty_ = dirty_ || kept > 0;
}

int RecordFile::sync() {
  if (!dirty_) return 0;
  dirty_ = false;
  return fdatasync(descriptor_) == 0 ? 0 : errno;
}

int RecordFile::close() {
  if (descriptor_ < 0) return 0;
  const int error = sync();
  const bool closed = ::close(std::exchange(descriptor_, -1)) == 0;
  if (bytes_ == 0) ::unlink(path_.c_str());
  return error != 0 ? error : closed ? 0 : errno;
}

void RecordFile::take_pending(RecordFile& other) {
  pending_.insert(pending_.end(), other.pending_.begin(), other.pending_.end());
  pending_sizes_.insert(pending_sizes_.end(), other.pending_sizes_.begin(), other.pending_sizes_.end());
  other.drop_pending();
}

std::uint64_t RecordFile::drop_pending() {
  const std::uint64_t records = pending_sizes_.size();
  pending_.clear();
  pending_sizes_.clear();
  return records;
}

void DiskState::note_failure(const std::filesystem::path& file, int error, std::int64_t now_ns,
                             std::uint64_t lost) {
  next_attempt_ns_ = now_ns + kRetryPeriodNs;
  if (std::exchange(blocked_, true)) return;
  lost_before_ = lost;
  report_(file.string() + ": cannot be written (" + std::strerror(error) + "); " + failure_advice(error));
}

void DiskState::note_success(const std::filesystem::path& file, std::uint64_t lost) {
  if (!std::exchange(blocked_, false)) return;
  report_(file.string() + ": writable again, " + std::to_string(lost - lost_before_) +
          " records were dropped meanwhile");
}

}  // namespace nilio::drivers
