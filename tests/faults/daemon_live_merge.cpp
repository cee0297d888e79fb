#include "../unit/hdl64e_packets.hpp"
#include "../unit/live_run.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;

// Not among the tests for ThreadSanitizer, with which poses do not keep up with the sensors.
TEST_CASE("a live LiDAR beside the first may fall silent and come back, and the poses go on") {
  const std::vector<std::uint16_t> ports = free_ports(2);
  Config config = live_config(ports);
  // So long that a busy computer does not matter.
  config.more_lidars[0].wait_ms = 500.0;
  LiveRun run(config);
  UdpSender sender;
  const std::vector<drivers::Packet> packets = vlp16_packets(3000);
  const auto start = std::chrono::steady_clock::now();
  std::size_t next = 0;
  const auto drive = [&](std::size_t count, bool with_second) {
    for (const std::size_t end = next + count; next < end; ++next) {
      std::this_thread::sleep_until(start + std::chrono::nanoseconds(next * 1'327'104));
      const std::vector<std::uint8_t> bytes(packets[next].data.begin(),
                                            packets[next].data.begin() + packets[next].size);
      sender.send(ports[0], bytes);
      if (with_second) sender.send(ports[1], bytes);
    }
    run.collect();
  };
  drive(800, true);
  const std::size_t poses_with_both = run.poses.size();
  CHECK(run.count_lines(LogLevel::kWarning, "") == 0);
  drive(800, false);
  CHECK(run.count_lines(LogLevel::kWarning, "lidar2: no packets come from it") == 1);
  CHECK(run.poses.size() > poses_with_both + 5);
  drive(800, true);
  run.stop();
  CHECK(run.count_lines(LogLevel::kWarning, "") == 1);
  CHECK(run.count_lines(LogLevel::kInfo, "lidar2: its packets come again in time") == 1);
  CHECK(run.count_lines(LogLevel::kInfo, "lidar2: LiDAR VLP-16 (from the packets)") == 1);
  const MergeCounters& merged = run.pipeline().merge_counters(1);
  CHECK(merged.points_merged > 0);
  CHECK(merged.scans_without >= 6);
  // Those after the last scan are still waiting.
  CHECK(run.pipeline().lidars()[1]->channel.stats().packets > 1600 - 80);
  CHECK(run.pipeline().packets_dropped() == 0);
}

TEST_CASE("a live LiDAR whose first neighbour never sends does not fill its ring", "[pipeline]") {
  const std::vector<std::uint16_t> ports = free_ports(2);
  LiveRun run(live_config(ports));
  UdpSender sender;
  const std::vector<drivers::Packet> packets = vlp16_packets(6000);
  for (std::size_t i = 0; i < packets.size(); ++i) {
    sender.send(ports[1], {packets[i].data.begin(), packets[i].data.begin() + packets[i].size});
    // Faster than the sensor would, but not faster than this computer.
    for (int k = 0; i % 30 == 0 && k < 20'000 && !run.has_delivered(1, i); ++k)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  for (int k = 0; k < 20'000 && run.pipeline().lidars()[1]->ring.size() > 2048; ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  CHECK(run.pipeline().lidars()[1]->ring.size() <= 2048);
  run.stop();
  CHECK(run.pipeline().lidars()[1]->ring.dropped() == 0);
  CHECK(run.pipeline().merge_counters(1).points_unused > 0);
  CHECK(run.poses.empty());
}
