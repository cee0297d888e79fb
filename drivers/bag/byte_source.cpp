#include "drivers/bag/readers.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace nilio::drivers::bag {

namespace {

class FileBytes : public ByteSource {
 public:
  FileBytes(int descriptor, std::uint64_t size, std::string name)
      : descriptor_(descriptor), size_(size), name_(std::move(name)) {}
  FileBytes(const FileBytes&) = delete;
  FileBytes& operator=(const FileBytes&) = delete;
  ~FileBytes() override { close(descriptor_); }

  std::size_t read(std::uint64_t offset, std::span<std::uint8_t> bytes) override {
    std::size_t done = 0;
    while (done < bytes.size()) {
      const ssize_t got =
          pread(descriptor_, bytes.data() + done, bytes.size() - done, static_cast<off_t>(offset + done));
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) break;
      done += static_cast<std::size_t>(got);
    }
    return done;
  }
  [[nodiscard]] std::uint64_t size() const override { return size_; }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  int descriptor_;
  std::uint64_t size_;
  std::string name_;
};

class MemoryBytes : public ByteSource {
 public:
  MemoryBytes(std::span<const std::uint8_t> bytes, std::string name)
      : bytes_(bytes), name_(std::move(name)) {}

  std::size_t read(std::uint64_t offset, std::span<std::uint8_t> bytes) override {
    if (offset >= bytes_.size()) return 0;
    const std::size_t count = std::min(bytes.size(), bytes_.size() - static_cast<std::size_t>(offset));
    std::copy_n(bytes_.begin() + static_cast<std::ptrdiff_t>(offset), count, bytes.begin());
    return count;
  }
  [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
  [[nodiscard]] const std::string& name() const override { return name_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::string name_;
};

}  // namespace

bool ByteSource::read_all(std::uint64_t offset, std::uint64_t count, std::vector<std::uint8_t>& buffer) {
  // The size of the file bounds the buffer, whatever is declared.
  const std::uint64_t left = offset < size() ? size() - offset : 0;
  buffer.resize(static_cast<std::size_t>(std::min(count, left)));
  buffer.resize(read(offset, buffer));
  return buffer.size() == count;
}

core::Result<std::unique_ptr<ByteSource>> open_file(const std::string& path) {
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat state {};
  if (descriptor < 0 || fstat(descriptor, &state) != 0 || !S_ISREG(state.st_mode)) {
    const std::string reason = descriptor < 0 ? std::strerror(errno) : "is no regular file";
    if (descriptor >= 0) close(descriptor);
    return core::Error{path + ": cannot be read (" + reason + ") - check path and permissions"};
  }
  posix_fadvise(descriptor, 0, 0, POSIX_FADV_SEQUENTIAL);
  return std::unique_ptr<ByteSource>(
      std::make_unique<FileBytes>(descriptor, static_cast<std::uint64_t>(state.st_size), path));
}

std::unique_ptr<ByteSource> view_memory(std::span<const std::uint8_t> bytes, std::string name) {
  return std::make_unique<MemoryBytes>(bytes, std::move(name));
}

}  // namespace nilio::drivers::bag
