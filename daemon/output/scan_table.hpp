#pragma once

#include "ipc/records.hpp"

#include <string>

namespace nilio::daemon {

/// First line of scans.csv: the names of the columns.
std::string scan_table_header();

/// Line of scans.csv for a scan: state, counters, speed, and the duration of each stage in microseconds,
/// empty where it is unknown. With its line end.
std::string scan_table_line(const ipc::PoseRecord& record);

}  // namespace nilio::daemon
