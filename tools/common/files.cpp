#include "tools/common/files.hpp"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

namespace nilio::tools {

namespace fs = std::filesystem;

core::Error cannot_write(const fs::path& path) {
  return core::Error{path.string() + ": cannot be written - check the folder and the space on the disk"};
}

std::optional<std::string> file_text(const fs::path& path) {
  const std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::ostringstream text;
  text << file.rdbuf();
  return std::move(text).str();
}

core::Result<std::monostate> write_text(const fs::path& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  if (file.flush()) return std::monostate{};
  return cannot_write(path);
}

UnfinishedFile::UnfinishedFile(fs::path path) : path_(std::move(path)) {
  std::error_code ignored;
  fs::remove(path_, ignored);
}

core::Result<std::monostate> UnfinishedFile::finish() const {
  std::error_code error;
  fs::rename(path(), path_, error);
  if (error)
    return core::Error{path() + ": cannot be renamed to " + path_.string() + " (" + error.message() +
                       ") - check the permissions of the folder"};
  return std::monostate{};
}

core::Result<WorkFolder> WorkFolder::create() {
  std::error_code error;
  std::string pattern = (fs::temp_directory_path(error) / "nilio_bench_XXXXXX").string();
  if (error || mkdtemp(pattern.data()) == nullptr)
    return core::Error{pattern + ": temporary folder could not be created (" + std::strerror(errno) +
                       ") - set TMPDIR to a writable folder"};
  return WorkFolder(pattern);
}

WorkFolder::~WorkFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace nilio::tools
