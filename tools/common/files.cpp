#include "tools/common/files.hpp"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>

namespace nilio::tools {

namespace fs = std::filesystem;

std::optional<std::string> file_text(const fs::path& path) {
  const std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::ostringstream text;
  text << file.rdbuf();
  return std::move(text).str();
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
