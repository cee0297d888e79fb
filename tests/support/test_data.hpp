#pragma once

#include "tests/support/paths.hpp"

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// A file or folder of the real recordings (NILIO_DATA, default ../shared/data beside the repository), if it
/// is there.
inline std::optional<std::filesystem::path> find_data(const std::string& relative) {
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

/// Leaves the test case, saying so, where the recordings are not there.
#define NILIO_REQUIRE_DATA(variable, relative)                       \
  const auto variable##_found = nilio::tests::find_data((relative)); \
  if (!variable##_found) {                                           \
    WARN("skipped: no data (" << (relative) << ")");                 \
    return;                                                          \
  }                                                                  \
  const std::filesystem::path variable = *variable##_found
