#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/messages.hpp"
#include "ipc/histogram.hpp"
#include "ipc/pose_record.hpp"

#include <string>
#include <string_view>

namespace nilio::dds {

/// The boot id of the running kernel: who has the same one has the same CLOCK_MONOTONIC. Empty where /proc
/// does not tell.
std::string read_host_id();

/// The report of a scan whose odometry was taken off the ring and written to DDS at these times
/// (CLOCK_MONOTONIC).
ScanReport make_scan_report(const ipc::PoseRecord& record, core::Time taken, core::Time written,
                            const std::string& host_id);

/// Makes `row` that of a latency report, with its buckets, eight to the octave. Its memory is used again.
void fill_stage_latency(std::string_view name, const ipc::Histogram& histogram, StageLatency& row);

}  // namespace nilio::dds
