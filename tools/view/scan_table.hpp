#pragma once

#include "nilio/core/time.hpp"

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace nilio::tools::view {

/// Columns of scans.csv of a run by name, every `stride`-th line, times as seconds since `start` under
/// "time_s"; and under "events" the changes of state, degradation level and time source, and losses, of all
/// lines. Null, with a line in `notes`, where the file is missing or damaged.
nlohmann::json read_scan_table(const std::filesystem::path& path, core::Time start, std::size_t stride,
                               std::vector<std::string>& notes);

}  // namespace nilio::tools::view
