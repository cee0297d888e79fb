#pragma once

#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "ipc/messages/messages.hpp"
#include "ipc/records.hpp"

#include <string>
#include <string_view>

namespace nilio::dds {

/// Boot id of the running kernel; equal ids mean the same CLOCK_MONOTONIC. Empty if /proc is not available.
std::string read_host_id();

/// Report of a scan whose odometry was read from the ring and written to DDS at these times
/// (CLOCK_MONOTONIC).
ScanReport make_scan_report(const ipc::PoseRecord& record, core::Time taken, core::Time written,
                            const std::string& host_id);

/// Fills a row of the latency report with buckets, eight per octave. Reuses its memory.
void fill_stage_latency(std::string_view name, const ipc::Histogram& histogram, StageLatency& row);

}  // namespace nilio::dds
