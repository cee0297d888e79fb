#pragma once

#include "ipc/dds/messages.hpp"

#include <cstddef>
#include <optional>
#include <string>

#include <nlohmann/json_fwd.hpp>

namespace nilio::tools {

/// Text from the network: nothing of it may steer the terminal.
std::string printable(const std::string& text, std::size_t longest = 32);

/// Tables on standard output.
void print_report(const dds::LatencyReport& report);
void print_imu_status(const dds::ImuPoseStatus& status);
void print_diagnostics(const dds::DiagnosticArray& diagnostics);

/// The same for programs: counters, and for each stage its percentiles in microseconds and its buckets as
/// [from, to, count].
nlohmann::json report_json(const dds::LatencyReport& report);
nlohmann::json imu_status_json(const dds::ImuPoseStatus& status);

}  // namespace nilio::tools
