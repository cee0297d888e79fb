#include "tests/support/paths.hpp"

#include <cstdlib>
#include <system_error>

namespace nilio::tests {

std::string source_folder() { return NILIO_SOURCE_DIR; }

std::string program_folder() { return NILIO_BIN_DIR; }

bool is_full_run() { return std::getenv("NILIO_FULL_TESTS") != nullptr; }

std::optional<std::filesystem::path> find_data(const std::string& relative) {
  const char* configured = std::getenv("NILIO_DATA");
  const std::filesystem::path root = configured != nullptr
                                         ? std::filesystem::path(configured)
                                         : std::filesystem::path(source_folder()) / "../shared/data";
  std::error_code ignored;
  const std::filesystem::path path = root / relative;
  if (std::filesystem::exists(path, ignored)) return path;
  return std::nullopt;
}

}  // namespace nilio::tests
