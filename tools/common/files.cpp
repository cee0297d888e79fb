#include "tools/common/work_folder.hpp"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <utility>

namespace nilio::tools {

namespace fs = std::filesystem;

core::Result<WorkFolder> WorkFolder::create() {
  std::error_code error;
  std::string pattern = (fs::temp_directory_path(error) / "nilio_bench_XXXXXX").string();
  if (error || mkdtemp(pattern.data()) == nullptr)
    return core::Error{pattern + ": a temporary folder cannot be made (" + std::strerror(errno) +
                       "): set TMPDIR to one that is writable"};
  return WorkFolder(pattern);
}

WorkFolder::WorkFolder(WorkFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}

WorkFolder::~WorkFolder() {
  std::error_code ignored;
  if (!path_.empty()) fs::remove_all(path_, ignored);
}

}  // namespace nilio::tools
