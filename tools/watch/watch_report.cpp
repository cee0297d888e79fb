#include "nilio/core/units.hpp"

#include "tools/watch/watch.hpp"

#include <algorithm>
#include <array>
#include <cstdio>

#include <nlohmann/json.hpp>

namespace nilio::tools::watch {
namespace {

constexpr std::size_t kLongestMessage = 240;

unsigned long long wide(std::uint64_t value) { return value; }

}  // namespace

std::string printable(const std::string& text, std::size_t longest) {
  std::string result = text.substr(0, longest);
  std::replace_if(
      result.begin(), result.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return result;
}

void print_report(const dds::LatencyReport& report) {
  std::printf(
      "\nthe publisher's last report: %llu poses published, %llu writes failed, %llu dropped before it, at "
      "most %llu waited\n",
      wide(report.poses_published), wide(report.failed_writes), wide(report.ring_dropped),
      wide(report.ring_high_water));
  if (report.imu_poses_published > 0)
    std::printf("at IMU rate: %llu poses published, %llu samples dropped before them, at most %llu waited\n",
                wide(report.imu_poses_published), wide(report.imu_ring_dropped),
                wide(report.imu_ring_high_water));
  std::printf("%-24s %10s %11s %11s %11s %11s %11s\n", "stage [us]", "count", "p50", "p90", "p99", "p99.9",
              "max");
  for (const dds::StageLatency& stage : report.stages) {
    std::printf("%-24s %10llu %11.1f %11.1f %11.1f %11.1f %11.1f\n", printable(stage.name).c_str(),
                wide(stage.count), stage.p50_us, stage.p90_us, stage.p99_us, stage.p99_9_us, stage.max_us);
  }
}

void print_imu_status(const dds::ImuPoseStatus& status) {
  std::printf(
      "\nIMU-rate poses: last correction %.3f m, %.2f deg%s; %llu jumps; %s\n", status.correction_m,
      status.correction_rad * kDegreesPerRadian, status.jumped ? " (jumped)" : "", wide(status.jumps),
      status.follows_gyro ? "rotation from the gyro" : "constant twist of the scan, no IMU in use");
}

void print_diagnostics(const dds::DiagnosticArray& diagnostics) {
  constexpr std::array levels = {"ok", "warning", "error", "stale"};
  std::printf("\n");
  for (const dds::DiagnosticStatus& status : diagnostics.statuses) {
    const std::size_t level = std::min(static_cast<std::size_t>(status.level), levels.size() - 1);
    std::printf("%-24s %-8s %s\n", printable(status.name).c_str(), levels[level],
                printable(status.message, kLongestMessage).c_str());
  }
}

nlohmann::json report_json(const dds::LatencyReport& report) {
  nlohmann::json json = {{"poses_published", report.poses_published},
                         {"failed_writes", report.failed_writes},
                         {"ring_dropped", report.ring_dropped},
                         {"ring_high_water", report.ring_high_water},
                         {"imu_poses_published", report.imu_poses_published},
                         {"imu_ring_dropped", report.imu_ring_dropped},
                         {"imu_ring_high_water", report.imu_ring_high_water}};
  json["stages"] = nlohmann::json::object();
  for (const dds::StageLatency& stage : report.stages) {
    nlohmann::json buckets = nlohmann::json::array();
    for (const dds::LatencyBucket& bucket : stage.buckets)
      buckets.push_back({bucket.from_us, bucket.to_us, bucket.count});
    json["stages"][printable(stage.name)] = {{"count", stage.count},       {"p50_us", stage.p50_us},
                                             {"p90_us", stage.p90_us},     {"p99_us", stage.p99_us},
                                             {"p99_9_us", stage.p99_9_us}, {"max_us", stage.max_us},
                                             {"buckets_us", buckets}};
  }
  return json;
}

nlohmann::json imu_status_json(const dds::ImuPoseStatus& status) {
  return {{"scan_sequence", status.scan_sequence},
          {"correction_m", status.correction_m},
          {"correction_deg", status.correction_rad * kDegreesPerRadian},
          {"jumped", status.jumped},
          {"follows_gyro", status.follows_gyro},
          {"jumps", status.jumps},
          {"published", status.published},
          {"thinned", status.thinned},
          {"withheld", status.withheld}};
}

}  // namespace nilio::tools::watch
