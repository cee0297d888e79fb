#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace nilio::tools {

/// All bytes of a file; nothing when it cannot be read.
std::optional<std::string> file_text(const std::filesystem::path& path);

}  // namespace nilio::tools
