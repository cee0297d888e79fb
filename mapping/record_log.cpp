#include "mapping/record_log.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "mapping/crc32c.hpp"

namespace nilio::mapping {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr std::size_t kFrameBytes = 4 + 2 + 2 + 8;
constexpr std::size_t kMaxPayload = std::size_t{64} << 20U;

Error failure(const fs::path& path, const char* action) {
  return Error{path.string() + ": " + action + " failed (" + std::strerror(errno) +
               ") - check that the folder is writable and the disk has space"};
}

class Descriptor {
 public:
  explicit Descriptor(int descriptor) : descriptor_(descriptor) {}
  ~Descriptor() {
    if (descriptor_ >= 0) close(descriptor_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  [[nodiscard]] int get() const { return descriptor_; }

 private:
  int descriptor_;
};

bool write_all(int descriptor, std::span<const std::uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t written = write(descriptor, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
  }
  return true;
}

}  // namespace

Result<Bytes> read_bytes(const fs::path& path) {
  const Descriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.get() < 0)
    return Error{path.string() + ": cannot be read (" + std::strerror(errno) + ") - check the path"};
  struct stat status {};
  if (fstat(file.get(), &status) != 0 || !S_ISREG(status.st_mode))
    return Error{path.string() + ": not a file - check the path"};
  Bytes bytes(static_cast<std::size_t>(status.st_size));
  std::size_t used = 0;
  while (used < bytes.size()) {
    const ssize_t count = read(file.get(), bytes.data() + used, bytes.size() - used);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return failure(path, "reading");
    if (count == 0) break;
    used += static_cast<std::size_t>(count);
  }
  bytes.resize(used);
  return bytes;
}

Result<std::monostate> replace_file(const fs::path& path, std::span<const std::uint8_t> bytes) {
  const fs::path temporary = path.string() + ".tmp." + std::to_string(getpid());
  unlink(temporary.c_str());
  {
    const Descriptor file(open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644));
    if (file.get() < 0) return failure(temporary, "creating");
    if (!write_all(file.get(), bytes)) return failure(temporary, "writing");
    if (fsync(file.get()) != 0) return failure(temporary, "syncing");
  }
  if (rename(temporary.c_str(), path.c_str()) != 0) return failure(path, "renaming");
  const Descriptor folder(open(path.parent_path().c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder.get() < 0 || fsync(folder.get()) != 0) return failure(path.parent_path(), "syncing");
  return std::monostate{};
}

Result<LogContent> read_log(const fs::path& path) {
  auto bytes = read_bytes(path);
  if (!bytes) return bytes.error();
  LogContent content;
  content.bytes = std::move(bytes).value();
  ByteReader in(content.bytes);
  while (in.left() > 0) {
    const std::size_t begin = content.bytes.size() - in.left();
    const auto length = in.get<std::uint32_t>();
    LogRecord record;
    record.type = in.get<std::uint16_t>();
    in.get<std::uint16_t>();
    const auto number = in.get<std::uint64_t>();
    record.payload = in.get_bytes(length);
    const std::span<const std::uint8_t> covered(content.bytes.data() + begin,
                                                kFrameBytes + record.payload.size());
    const auto checksum = in.get<std::uint32_t>();
    if (in.failed() || length > kMaxPayload || number != content.records.size() ||
        crc32c(covered) != checksum)
      break;
    content.records.push_back(record);
    content.valid_bytes = content.bytes.size() - in.left();
  }
  return content;
}

Result<RecordLog> RecordLog::open(const fs::path& path, std::size_t valid_bytes, std::uint64_t records) {
  const int file = ::open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0644);
  if (file < 0) return failure(path, "opening");
  RecordLog log(path, file, records);
  if (ftruncate(file, static_cast<off_t>(valid_bytes)) != 0) return failure(path, "truncating");
  if (lseek(file, 0, SEEK_END) < 0) return failure(path, "seeking in");
  return log;
}

RecordLog::RecordLog(RecordLog&& other) noexcept
    : path_(std::move(other.path_)),
      file_descriptor_(std::exchange(other.file_descriptor_, -1)),
      next_(other.next_) {}

RecordLog& RecordLog::operator=(RecordLog&& other) noexcept {
  if (this == &other) return *this;
  if (file_descriptor_ >= 0) close(file_descriptor_);
  path_ = std::move(other.path_);
  file_descriptor_ = std::exchange(other.file_descriptor_, -1);
  next_ = other.next_;
  return *this;
}

RecordLog::~RecordLog() {
  if (file_descriptor_ >= 0) close(file_descriptor_);
}

bool RecordLog::lock() { return flock(file_descriptor_, LOCK_EX | LOCK_NB) == 0; }

Result<std::monostate> RecordLog::append(std::uint16_t type, std::span<const std::uint8_t> payload,
                                         bool sync) {
  ByteWriter out;
  out.put(static_cast<std::uint32_t>(payload.size()));
  out.put(type);
  out.put(std::uint16_t{0});
  out.put(next_);
  out.put_bytes(payload);
  out.put(crc32c(out.bytes()));
  const off_t before = lseek(file_descriptor_, 0, SEEK_END);
  if (!write_all(file_descriptor_, out.bytes())) {
    const Error error = failure(path_, "writing");
    // A partial record would hide those that follow.
    if (before >= 0 && ftruncate(file_descriptor_, before) == 0) lseek(file_descriptor_, 0, SEEK_END);
    return error;
  }
  ++next_;
  if (sync && fdatasync(file_descriptor_) != 0) return failure(path_, "syncing");
  return std::monostate{};
}

}  // namespace nilio::mapping
