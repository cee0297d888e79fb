#include "tools/common/file_text.hpp"

#include <fstream>
#include <sstream>

namespace nilio::tools {

std::optional<std::string> file_text(const std::filesystem::path& path) {
  const std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::ostringstream text;
  text << file.rdbuf();
  return std::move(text).str();
}

}  // namespace nilio::tools
