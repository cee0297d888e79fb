#pragma once

#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/messages/messages.hpp"

#include <cstddef>
#include <cstdint>
#include <string>

#include <nlohmann/json_fwd.hpp>

namespace nilio::tools::watch {

/// Options of "nilio watch".
struct Options {
  dds::OdometrySubscriberConfig subscriber;
  /// Poses after which it ends; 0 = never.
  std::uint64_t count = 0;
  /// Ends after this long without a pose; 0 = never.
  double timeout_s = 0.0;
  /// Files to write; empty = none.
  std::string tum_path;
  std::string json_path;
};

/// Shows the published poses until SIGINT, SIGTERM, `count` or `timeout_s`, then prints a summary. Returns
/// the exit status: 1 without any pose and when a file could not be written, with a message on standard
/// error.
int run(const Options& options);

/// Text from the network without control characters, at most `longest` characters.
std::string printable(const std::string& text, std::size_t longest = 32);

/// Tables on standard output.
void print_report(const dds::LatencyReport& report);
void print_imu_status(const dds::ImuPoseStatus& status);
void print_diagnostics(const dds::DiagnosticArray& diagnostics);

/// The same as JSON: counters, and for each stage its percentiles in microseconds and its buckets as [from,
/// to, count].
nlohmann::json report_json(const dds::LatencyReport& report);
nlohmann::json imu_status_json(const dds::ImuPoseStatus& status);

}  // namespace nilio::tools::watch
