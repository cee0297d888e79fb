#pragma once

#include "nilio/core/result.hpp"

#include <string>
#include <string_view>
#include <vector>

namespace nilio::daemon {

/// Kernel numbers of CPUs, ascending; empty = any.
using CpuList = std::vector<int>;

/// Parses a list in the format of taskset and systemd: "0", "1-2,4" or "". The error names the invalid item;
/// numbers above 1023 are invalid.
core::Result<CpuList> parse_cpu_list(std::string_view text);
/// Inverse of parse_cpu_list(): "1-2,4".
std::string cpu_list_text(const CpuList& cpus);

}  // namespace nilio::daemon
