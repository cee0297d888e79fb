#include "tools/watch/packet_to_pose.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using tools::watch::PacketToPose;

namespace {

dds::ScanReport report(std::int64_t stamp, std::int64_t received_ns, const std::string& host = "here") {
  dds::ScanReport report;
  report.stamp = {stamp};
  report.host_id = host;
  report.stages = {{"received", received_ns}, {"written", received_ns + 20}};
  return report;
}

}  // namespace

TEST_CASE("a pose and the report of its scan are matched in any order of arrival", "[packet_to_pose]") {
  PacketToPose latency("here");
  latency.add_pose({100}, 1'000'000);
  latency.add_report(report(100, 400'000));
  latency.add_report(report(200, 2'000'000));
  latency.add_pose({300}, 4'000'000);  // its report is missing
  latency.add_pose({200}, 3'000'000);
  const auto snapshot = latency.histogram().snapshot();
  CHECK(snapshot.count() == 2);
  CHECK(snapshot.min() == 600'000);
  CHECK(snapshot.max() == 1'000'000);
  latency.add_pose({200}, 9'000'000);  // repeated: its report was already matched
  CHECK(latency.histogram().snapshot().count() == 2);
}

TEST_CASE("reports of another machine or without the stamp are not measured", "[packet_to_pose]") {
  PacketToPose latency("here");
  latency.add_pose({100}, 1'000'000);
  latency.add_report(report(100, 400'000, "there"));
  latency.add_report(report(100, 400'000, ""));
  latency.add_report(report(100, 0));
  dds::ScanReport bare = report(100, 1);
  bare.stages.clear();
  latency.add_report(bare);
  CHECK(latency.histogram().snapshot().count() == 0);
  CHECK(latency.of_other_machines() == 2);
}

TEST_CASE("items without a counterpart do not accumulate", "[packet_to_pose]") {
  PacketToPose latency("here");
  for (std::int64_t i = 0; i < 100'000; ++i) latency.add_pose({i}, i + 1);
  for (std::int64_t i = 0; i < 100'000; ++i) latency.add_report(report(i, i + 1));
  CHECK(latency.histogram().snapshot().count() == 256);  // the last poses
}
