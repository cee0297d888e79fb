#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace nilio::daemon {

/// Processors by the kernel's numbers, ascending; empty = any.
using CpuList = std::vector<int>;

/// "0", "1-2,4" or "" as taskset and systemd write them. Fails on anything else and on numbers above 1023,
/// naming what was wrong.
core::Result<CpuList> parse_cpu_list(std::string_view text);
/// The inverse: "1-2,4".
std::string cpu_list_text(const CpuList& cpus);

}  // namespace nilio::daemon
