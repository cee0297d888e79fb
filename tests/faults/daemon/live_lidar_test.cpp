#include "tests/support/hdl64e_packets.hpp"
#include "tests/support/live_run.hpp"
#include "tests/support/paths.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;
using drivers::kHdl64eStatusPackets;

TEST_CASE("a live sensor is identified from its packets, and none of them is lost",
          "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  LiveRun run(live_config({port}));
  UdpSender sender;
  run.send(sender, 0, port, vlp16_packets(400));
  run.stop();
  const drivers::ScanAssemblerStats stats = run.pipeline().scan_stats();
  CHECK(stats.packets == 400);
  CHECK(stats.firings == 400 * 384);
  // Scans after the cut; the fifth may be incomplete at the end.
  CHECK(stats.scans == 5);
  CHECK(stats.partial_scans <= 1);
  CHECK(run.count_lines(LogLevel::kInfo, "LiDAR VLP-16 (from the packets)") == 1);
  CHECK(run.count_lines(LogLevel::kError, "") == 0);
  CHECK_FALSE(run.poses.empty());
}

TEST_CASE("live packets that contradict the configured model are logged once, and the model is kept",
          "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  Config config = live_config({port});
  config.lidar.model = "HDL-64E-S2";
  config.lidar.calibration = source_folder() + "/config/calibration/hdl64e_s2_kitti.yaml";
  LiveRun run(config);
  UdpSender sender;
  run.send(sender, 0, port, vlp16_packets(320));
  run.collect();
  const std::string warning = "lidar.model is HDL-64E-S2, but the packets look like those of VLP-16";
  CHECK(run.count_lines(LogLevel::kWarning, warning) == 1);
  CHECK_FALSE(run.pipeline().finished());
  run.send(sender, 0, port, hdl64e_packets(1200, StatusStream::kWhole));
  run.stop();
  CHECK_FALSE(run.poses.empty());
  CHECK(run.count_lines(LogLevel::kError, "") == 0);
  CHECK(run.pipeline().scan_stats().packets == 1520);
}

TEST_CASE("a live sensor that cannot be identified is an error and does not end the run",
          "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  LiveRun run(live_config({port}));
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp32b);
  std::vector<drivers::Packet> packets;
  for (std::size_t i = 0; i < 256; ++i) packets.push_back(turning.packet(i));
  UdpSender sender;
  run.send(sender, 0, port, packets);
  CHECK_FALSE(run.pipeline().finished());
  run.stop();
  CHECK(run.poses.empty());
  CHECK(run.count_lines(LogLevel::kError, "select one with lidar.model") == 1);
}

TEST_CASE("datagrams of other sizes before the first data packet are counted and discarded",
          "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  LiveRun run(live_config({port}));
  drivers::Packet other;
  other.size = 100;
  UdpSender sender;
  run.send(sender, 0, port, std::vector<drivers::Packet>(200, other));
  run.send(sender, 0, port, vlp16_packets(200));
  run.stop();
  CHECK(run.pipeline().scan_stats().bad_length == 200);
  CHECK(run.pipeline().scan_stats().packets == 200);
  CHECK(run.pipeline().scan_stats().scans == 2);
}

TEST_CASE("a live HDL-64E is decoded with its transmitted calibration from the first packet",
          "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  LiveRun run(live_config({port}));
  UdpSender sender;
  run.send(sender, 0, port, hdl64e_packets(2 * kHdl64eStatusPackets, StatusStream::kWhole, 100));
  run.stop();
  const drivers::ScanAssembler* assembler = run.pipeline().lidars().front()->channel.assembler();
  REQUIRE(assembler != nullptr);
  CHECK(assembler->sensor().lasers[5].elevation_rad == make_writer().calibration().lasers[5].elevation_rad);
  CHECK(run.pipeline().scan_stats().packets == 2 * kHdl64eStatusPackets);
  CHECK(run.pipeline().scan_stats().firings == 2 * kHdl64eStatusPackets * 384);
  CHECK(run.pipeline().scan_stats().lost_packets == 0);
  CHECK(run.count_lines(LogLevel::kInfo, "its own status stream") == 1);
  CHECK_FALSE(run.poses.empty());
}

TEST_CASE("another sender to a live sensor's port costs one warning and no pose", "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  LiveRun run(live_config({port}));
  UdpSender sensor("127.0.0.1");
  UdpSender other("127.0.0.2");
  const std::vector<drivers::Packet> packets = vlp16_packets(1600);
  const std::vector<drivers::Packet> others = hdl64e_packets(160, StatusStream::kWhole);
  // A stray packet before the first one, then twenty and more a second.
  run.send(other, 0, port, std::span(others).first(1));
  for (std::size_t i = 0; i < 160; ++i) {
    run.send(sensor, 0, port, std::span(packets).subspan(10 * i, 10));
    if (i > 0) run.send(other, 0, port, std::span(others).subspan(i, 1));
  }
  run.stop();
  const drivers::ScanAssemblerStats stats = run.pipeline().scan_stats();
  CHECK(stats.packets == 1600);
  CHECK(stats.firings == 1600 * 384);
  CHECK(stats.lost_packets == 0);
  CHECK(stats.scans == 21);
  CHECK(run.pipeline().foreign_packets() == 160);
  CHECK(run.count_lines(LogLevel::kWarning, "packets from 127.0.0.2 are counted and not decoded") == 1);
  CHECK(run.count_lines(LogLevel::kInfo, "LiDAR VLP-16 (from the packets)") == 1);
}

TEST_CASE("the status of a live stream is logged once after the first scans", "[live_lidar][pipeline]") {
  const std::uint16_t port = free_port();
  LiveRun run(live_config({port}));
  UdpSender sender;
  run.send(sender, 0, port, vlp16_packets(1600));
  run.stop();
  CHECK(run.count_lines(LogLevel::kInfo, "VLP-16: return mode ") == 1);
  CHECK(run.count_lines(LogLevel::kInfo, "a packet every 1327.1 us, field of view 360 deg") == 1);
}

TEST_CASE("a packet ring holds about a second of its sensor's packets", "[live_lidar][pipeline]") {
  for (const auto& [model, slots] : {std::pair{"VLP-16", 2048U}, std::pair{"HDL-32E", 4096U},
                                     std::pair{"VLS-128", 16384U}, std::pair{"auto", 16384U}}) {
    Config config = live_config({free_port()});
    config.lidar.model = model;
    LiveRun run(config);
    CAPTURE(model);
    CHECK(run.pipeline().lidars().front()->ring.capacity() == slots);
    run.stop();
  }
}
