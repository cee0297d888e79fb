#include "tests/support/hdl64e_packets.hpp"
#include "tests/support/live_run.hpp"
#include "tests/support/paths.hpp"

#include <algorithm>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;

// Excluded from the ThreadSanitizer run, in which poses cannot keep up with the sensors.
TEST_CASE("poses continue while an additional live LiDAR is silent, also after it comes back",
          "[live_merge]") {
  const std::vector<std::uint16_t> ports = free_ports(2);
  Config config = live_config(ports);
  // Long enough for a busy computer.
  config.more_lidars[0].wait_ms = 500.0;
  LiveRun run(config);
  UdpSender sender;
  const std::vector<drivers::Packet> packets = vlp16_packets(3000);
  auto due = std::chrono::steady_clock::now();
  std::size_t next = 0;
  std::uint64_t sent_to_second = 0;
  // Less than one scan: no scan of the first LiDAR is superseded, and each finds packets of the second while
  // it transmits.
  constexpr std::size_t kMostWaiting = 50;
  const auto drive = [&](std::size_t count, bool with_second) {
    for (const std::size_t end = next + count; next < end; ++next) {
      // Sends at the sensor's pace, or at that of a computer that cannot keep up.
      due = std::max(due + std::chrono::nanoseconds(1'327'104), std::chrono::steady_clock::now());
      std::this_thread::sleep_until(due);
      REQUIRE(run.drains(0, kMostWaiting));
      REQUIRE(run.receives(1, sent_to_second - std::min<std::uint64_t>(sent_to_second, kMostWaiting)));
      const std::vector<std::uint8_t> bytes(packets[next].data.begin(),
                                            packets[next].data.begin() + packets[next].size);
      sender.send(ports[0], bytes);
      if (!with_second) continue;
      sender.send(ports[1], bytes);
      ++sent_to_second;
    }
    run.collect();
  };
  // The packets that identify the models complete no scan yet.
  drive(70, true);
  for (const auto& input : run.pipeline().lidars())
    REQUIRE(eventually([&] { return input->channel.is_identified(); }));
  drive(930, true);
  const std::size_t poses_with_both = run.poses.size();
  // A clock warning is acceptable: a busy computer does not send at a sensor's regular pace, and the clocks
  // follow the arrival times.
  const std::string silent = "lidar2: no packets received";
  CHECK(run.count_lines(LogLevel::kWarning, silent) == 0);
  drive(1000, false);
  CHECK(run.count_lines(LogLevel::kWarning, silent) == 1);
  CHECK(run.poses.size() > poses_with_both + 5);
  drive(1000, true);
  run.stop();
  for (const EventLog::Line& line : run.lines) UNSCOPED_INFO(line.text);
  CHECK(run.count_lines(LogLevel::kWarning, silent) == 1);
  CHECK(run.count_lines(LogLevel::kInfo, "lidar2: packets arrive in time again") == 1);
  CHECK(run.count_lines(LogLevel::kInfo, "lidar2: LiDAR VLP-16 (from the packets)") == 1);
  const MergeCounters& merged = run.pipeline().merge_counters(1);
  CHECK(merged.points_merged > 0);
  CHECK(merged.scans_without >= 6);
  // Points after the last scan are still pending.
  CHECK(run.pipeline().lidars()[1]->channel.stats().packets > 2000 - 80);
  CHECK(run.pipeline().packets_dropped() == 0);
}

TEST_CASE("an additional live LiDAR does not fill its ring while the first one is silent",
          "[live_merge][pipeline]") {
  const std::vector<std::uint16_t> ports = free_ports(2);
  Config config = live_config(ports);
  config.more_lidars[0].model = "VLP-16";
  LiveRun run(config);
  UdpSender sender;
  const std::vector<drivers::Packet> packets = vlp16_packets(6000);
  for (std::size_t i = 0; i < packets.size(); ++i) {
    sender.send(ports[1], {packets[i].data.begin(), packets[i].data.begin() + packets[i].size});
    // Faster than the sensor, but not faster than this computer.
    if (i % 30 == 0) REQUIRE(eventually([&] { return run.has_delivered(1, i); }));
  }
  CHECK(run.drains(1, run.pipeline().lidars()[1]->ring.capacity() / 2));
  run.stop();
  CHECK(run.pipeline().lidars()[1]->ring.dropped() == 0);
  CHECK(run.pipeline().merge_counters(1).points_unused > 0);
  CHECK(run.poses.empty());
}

TEST_CASE("live packets share wake-ups while no scan can be complete", "[live_merge][timed]") {
  const std::uint16_t port = free_port();
  Config config = live_config({port});
  config.lidar.model = "HDL-64E-S2";
  config.lidar.calibration = source_folder() + "/config/calibration/hdl64e_s2_kitti.yaml";
  LiveRun run(config);
  UdpSender sender;
  const std::vector<drivers::Packet> packets = hdl64e_packets(10'000, StatusStream::kWhole);
  const auto start = std::chrono::steady_clock::now();
  for (std::size_t i = 0; i < packets.size(); ++i) {
    std::this_thread::sleep_until(start + i * std::chrono::microseconds(288));
    sender.send(port, {packets[i].data.begin(), packets[i].data.begin() + packets[i].size});
  }
  REQUIRE(run.receives(0, packets.size()));
  std::uint64_t rounds = 0;
  for (const RealtimeThread& thread : run.pipeline().threads())
    if (thread.role() == ThreadRole::kLidarReceive) rounds = thread.heartbeat().value_or(0);
  run.stop();
  CHECK(run.poses.size() > 20);
  // One for each read; sanitizers slow the gathering down.
  CHECK(rounds > 0);
  CHECK(rounds < packets.size() * 3 / 4);
}
