// Folders of the build that runs, and the real recordings. Their names are compiled into one file, so that
// builds in different folders share the objects of all others in a compiler cache.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace nilio::tests {

/// Root of the sources, without a slash at the end.
std::string source_folder();

/// Folder of the programs that were built, without a slash at the end.
std::string program_folder();

/// True in `tools/test.sh --full` (NILIO_FULL_TESTS), which repeats drives with more seeds.
bool is_full_run();

/// A file or folder of the real recordings (NILIO_DATA, default ../shared/data beside the repository), if it
/// is there.
std::optional<std::filesystem::path> find_data(const std::string& relative);

}  // namespace nilio::tests

/// Leaves the test case, saying so, where the recordings are not there.
#define NILIO_REQUIRE_DATA(variable, relative)                       \
  const auto variable##_found = nilio::tests::find_data((relative)); \
  if (!variable##_found) {                                           \
    WARN("skipped: no data (" << (relative) << ")");                 \
    return;                                                          \
  }                                                                  \
  const std::filesystem::path variable = *variable##_found
