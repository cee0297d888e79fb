#include "record_file.hpp"

#include <cerrno>
#include <fcntl.h>
#include <unistd.h>
#include <utility>

namespace nilio::tools {

RecordFile::RecordFile(std::filesystem::path path, std::vector<std::uint8_t> header)
    : path_(std::move(path)), header_(std::move(header)) {}

RecordFile::RecordFile(RecordFile&& other) noexcept { *this = std::move(other); }

RecordFile& RecordFile::operator=(RecordFile&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(header_, other.header_);
  std::swap(pending_, other.pending_);
  std::swap(pending_records_, other.pending_records_);
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

void RecordFile::append(std::span<const std::uint8_t> record) {
  pending_.insert(pending_.end(), record.begin(), record.end());
  ++pending_records_;
}

int RecordFile::open() {
  descriptor_ = ::open(path_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor_ < 0) return errno;
  // The name, too, has to survive the loss of power.
  const int folder = ::open(path_.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (folder >= 0) {
    fsync(folder);
    ::close(folder);
  }
  return 0;
}

int RecordFile::write_all(std::span<const std::uint8_t> bytes) {
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
  const std::uint64_t after = bytes_with_pending();
  int error = bytes_ == 0 ? write_all(header_) : 0;
  if (error == 0) error = write_all(pending_);
  if (error != 0) {
    const auto whole = static_cast<off_t>(bytes_);
    spoiled_ = ftruncate(descriptor_, whole) != 0 || lseek(descriptor_, whole, SEEK_SET) != whole;
    return error;
  }
  bytes_ = after;
  dirty_ = true;
  pending_.clear();
  pending_records_ = 0;
  return 0;
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
  pending_records_ += other.pending_records_;
  other.drop_pending();
}

std::uint64_t RecordFile::drop_pending() {
  pending_.clear();
  return std::exchange(pending_records_, 0);
}

}  // namespace nilio::tools
