#include "daemon/input/lidar_channel.hpp"

#include "daemon/input/receive.hpp"
#include "daemon/input/scan_feed.hpp"
#include "tests/support/hdl64e_packets.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;

namespace {

constexpr std::uint32_t kSensor = 0xC0A801C9;
constexpr std::uint32_t kOther = 0xC0A801CA;

/// A channel that the test feeds.
class ChannelRun {
 public:
  explicit ChannelRun(LidarConfig config = {}, std::optional<drivers::VelodyneSensor> sensor = std::nullopt)
      : config_(std::move(config)),
        data_event_(ipc::WakeEvent::create()),
        channel_("lidar", config_, {}, std::move(sensor), ring_, state_, log_),
        feed_(channel_, *data_event_, &gather_until_ns) {}

  void receive(std::span<const drivers::Packet> packets) {
    for (drivers::Packet packet : packets) {
      packet.received_ns = monotonic_ns();
      REQUIRE(ring_.try_push(packet));
    }
  }

  void push(const drivers::Packet& packet) { REQUIRE(ring_.try_push(packet)); }

  /// Receives packets from this sender in small portions and decodes them.
  void decode(std::vector<drivers::Packet> packets, std::uint32_t sender) {
    for (drivers::Packet& packet : packets) {
      packet.sender_address = sender;
      receive({&packet, 1});
      poll();
    }
  }

  void poll() {
    core::Scan scan;
    while (feed_.poll(scan) == FeedState::kScan) scans.push_back(scan);
  }

  [[nodiscard]] std::size_t count_lines(const std::string& text) {
    while (auto line = log_.take()) lines_.push_back(line->text);
    return static_cast<std::size_t>(std::count_if(lines_.begin(), lines_.end(), [&](const auto& line) {
      return line.find(text) != std::string::npos;
    }));
  }

  [[nodiscard]] LidarChannel& channel() { return channel_; }
  [[nodiscard]] PacketScanFeed& feed() { return feed_; }
  [[nodiscard]] ReceiveState& state() { return state_; }

  std::vector<core::Scan> scans;
  std::atomic<std::int64_t> gather_until_ns{0};

 private:
  LidarConfig config_;
  ipc::Ring<drivers::Packet> ring_ = ipc::Ring<drivers::Packet>::in_private_memory(2048);
  ReceiveState state_;
  EventLog log_;
  core::Result<ipc::WakeEvent> data_event_;
  LidarChannel channel_;
  PacketScanFeed feed_;
  std::vector<std::string> lines_;
};

LidarConfig config_of(const std::string& model) {
  LidarConfig config;
  config.model = model;
  return config;
}

bool has_same_points(const core::Scan& a, const core::Scan& b) {
  return a.start == b.start && a.end == b.end && a.points.size() == b.points.size() &&
         std::equal(a.points.begin(), a.points.end(), b.points.begin(), [](const auto& p, const auto& q) {
           return p.x == q.x && p.y == q.y && p.z == q.z && p.time_offset_ns == q.time_offset_ns;
         });
}

/// A rotating HDL-32E from `start_ns`.
std::vector<drivers::Packet> hdl32e_packets(std::size_t count, std::int64_t start_ns) {
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl32e);
  turning.start_ns = start_ns;
  std::vector<drivers::Packet> packets;
  for (std::size_t i = 0; i < count; ++i) packets.push_back(turning.packet(i));
  return packets;
}

}  // namespace

TEST_CASE("packets buffered during identification count neither as late nor as backlog, later ones do",
          "[lidar_channel]") {
  ChannelRun run;
  const std::vector<drivers::Packet> packets = vlp16_packets(1600);
  const std::span<const drivers::Packet> all(packets);

  run.receive(all.first(800));
  REQUIRE_FALSE(run.channel().is_identified());
  const std::int64_t known_ns = monotonic_ns();
  REQUIRE(run.channel().front() != nullptr);
  REQUIRE(run.channel().is_identified());
  // The packet that identified the model leaves the others in the ring.
  REQUIRE(run.channel().packets_in_ring() > 600);
  core::Scan scan;
  int scans = 0;
  for (; run.feed().poll(scan) == FeedState::kScan; ++scans) {
    CHECK(run.feed().waiting_scans() == 0);
    CHECK(scan.received_ns >= known_ns);
  }
  CHECK(scans >= 9);

  // Packets of the start count as backlog of the socket.
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  run.receive(all.subspan(800));
  const std::int64_t received_ns = monotonic_ns();
  REQUIRE(run.feed().poll(scan) == FeedState::kScan);
  CHECK(run.feed().waiting_scans() >= 8);
  CHECK(scan.received_ns <= received_ns);
}

TEST_CASE("a configured model is decoded as soon as its sender is known, and none of its packets is lost",
          "[lidar_channel]") {
  ChannelRun configured(config_of("VLP-16"));
  ChannelRun given({}, drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16));
  const std::vector<drivers::Packet> packets = vlp16_packets(400);
  configured.decode({packets.begin(), packets.begin() + SenderSelection::kSteadyPackets - 1}, kSensor);
  CHECK_FALSE(configured.channel().is_identified());
  CHECK(configured.channel().assembler() != nullptr);
  configured.decode({packets.begin() + SenderSelection::kSteadyPackets - 1, packets.end()}, kSensor);
  given.decode(packets, kSensor);
  CHECK(configured.channel().stats().firings == 400 * 384);
  REQUIRE(configured.scans.size() == given.scans.size());
  for (std::size_t i = 0; i < given.scans.size(); ++i)
    CHECK(has_same_points(configured.scans[i], given.scans[i]));
  CHECK(configured.count_lines("LiDAR VLP-16") == 1);
}

TEST_CASE("packets of another sender are counted and change no scan", "[lidar_channel]") {
  ChannelRun alone(config_of("VLP-16"));
  ChannelRun disturbed(config_of("VLP-16"));
  const std::vector<drivers::Packet> packets = vlp16_packets(800);
  alone.decode(packets, kSensor);
  const std::vector<drivers::Packet> others = hdl32e_packets(801, kEpochNs + 1'000'000'000);
  // The very first packet is a foreign one.
  disturbed.decode({others.front()}, kOther);
  for (std::size_t i = 0; i < packets.size(); ++i) {
    disturbed.decode({packets[i]}, kSensor);
    drivers::Packet other = others[i + 1];
    other.stamp = packets[i].stamp;
    if (i % 3 == 0) disturbed.decode({other}, kOther);
    // Another sensor's position packets say nothing about this one's clock.
    other.size = drivers::kPositionPacketSize;
    if (i % 10 == 0) disturbed.decode({other}, kOther);
  }
  REQUIRE(disturbed.scans.size() == alone.scans.size());
  for (std::size_t i = 0; i < alone.scans.size(); ++i)
    CHECK(has_same_points(disturbed.scans[i], alone.scans[i]));
  CHECK(disturbed.channel().foreign_packets() == 1 + 267 + 80);
  CHECK(disturbed.channel().stats().packets == 800);
  CHECK(disturbed.channel().stats().position_packets == 0);
  CHECK(disturbed.count_lines("packets from 192.168.1.202 are counted and not decoded; the sensor is "
                              "192.168.1.201") == 1);
  CHECK(alone.channel().foreign_packets() == 0);
}

TEST_CASE("the model is identified from the sensor's packets, not from a stray sender's", "[lidar_channel]") {
  ChannelRun run;
  const std::vector<drivers::Packet> packets = vlp16_packets(200);
  const std::vector<drivers::Packet> others = hdl32e_packets(200, kEpochNs);
  for (std::size_t i = 0; i < packets.size(); ++i) {
    if (i % 4 == 0) run.decode({others[i]}, kOther);
    run.decode({packets[i]}, kSensor);
  }
  REQUIRE(run.channel().assembler() != nullptr);
  CHECK(run.channel().assembler()->sensor().name == "VLP-16");
  CHECK(run.channel().stats().firings == 200 * 384);
}

TEST_CASE("a sensor with another address is decoded after the previous one fell silent", "[lidar_channel]") {
  const std::vector<drivers::Packet> before = vlp16_packets(800);
  constexpr std::int64_t kSilenceNs = 10'000'000'000;
  SECTION("the same model") {
    ChannelRun run(config_of(GENERATE("auto", "VLP-16")));
    run.decode(before, kSensor);
    const std::size_t scans = run.scans.size();
    TurningSensor turning;
    turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
    turning.start_ns = kEpochNs + kSilenceNs;
    std::vector<drivers::Packet> after;
    for (std::size_t i = 0; i < 800; ++i) after.push_back(turning.packet(i));
    run.decode(after, kOther);
    CHECK(run.scans.size() >= scans + 8);
    CHECK(run.count_lines("packets now come from 192.168.1.202") == 1);
    CHECK(run.channel().foreign_packets() == SenderSelection::kSteadyPackets - 1);
    CHECK(run.channel().stats().packets == 1600 - run.channel().foreign_packets());
    for (std::size_t i = 1; i < run.scans.size(); ++i) {
      CHECK(run.scans[i].sequence == run.scans[i - 1].sequence + 1);
      CHECK(run.scans[i].start > run.scans[i - 1].start);
    }
  }
  SECTION("another model") {
    ChannelRun run;
    run.decode(before, kSensor);
    const std::size_t scans = run.scans.size();
    run.decode(hdl32e_packets(1800, kEpochNs + kSilenceNs), kOther);
    REQUIRE(run.scans.size() >= scans + 8);
    CHECK(run.channel().assembler()->sensor().name == "HDL-32E");
    CHECK(run.count_lines("LiDAR HDL-32E (from the packets)") == 1);
    CHECK(run.scans[scans].after_time_jump);
    CHECK(run.scans[scans].sequence == run.scans[scans - 1].sequence + 1);
  }
}

TEST_CASE("a clock that was set and another return mode are reported with their scan, once",
          "[lidar_channel]") {
  ChannelRun run;
  run.decode(vlp16_packets(800), kSensor);
  const std::size_t scans = run.scans.size();
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  turning.start_azimuth_deg = 180.0;
  turning.start_ns = turning.packet_time_ns(800);
  std::string wanted;
  SECTION("the sensor's clock") {
    turning.sensor_ahead_ns = 100'000'000'000;
    wanted = ": the clock of lidar was set, or the sensor was restarted; its timeline starts again";
  }
  SECTION("the computer's clock") {
    turning.start_ns += 100'000'000'000;
    turning.sensor_ahead_ns = -100'000'000'000;
    wanted = ": the computer's clock was set; the time stamps of lidar follow it";
  }
  SECTION("the return mode") {
    turning.mode = drivers::ReturnMode::kDual;
    wanted = ": return mode of lidar is dual now";
  }
  std::vector<drivers::Packet> after;
  for (std::size_t i = 0; i < 800; ++i) after.push_back(turning.packet(i));
  run.decode(after, kSensor);
  REQUIRE(run.scans.size() > scans + 2);
  CHECK(run.count_lines(wanted) == 1);
  // Not before the seam: a step of the computer's clock is taken for one only after several packets.
  std::size_t after_the_seam = 0;
  for (std::size_t i = scans; i < run.scans.size(); ++i)
    after_the_seam += run.count_lines("scan " + std::to_string(run.scans[i].sequence) + wanted);
  CHECK(after_the_seam == 1);
  CHECK(run.count_lines("map and pose are kept") == 1);
}

TEST_CASE("a short recording of one sender is decoded although nobody is steady", "[lidar_channel]") {
  ChannelRun run({}, drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16));
  run.receive(std::vector<drivers::Packet>(vlp16_packets(20)));
  run.poll();
  CHECK(run.channel().stats().firings == 0);
  run.state().ended.store(true);
  run.poll();
  CHECK(run.channel().stats().firings == 20 * 384);
}

TEST_CASE("packets dropped for a full ring are not lost in the network", "[lidar_channel]") {
  ChannelRun run({}, drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16));
  const std::vector<drivers::Packet> packets = vlp16_packets(1000);
  // 10 were lost in the network, 30 in this computer.
  run.decode({packets.begin(), packets.begin() + 300}, kSensor);
  run.decode({packets.begin() + 310, packets.begin() + 600}, kSensor);
  run.decode({packets.begin() + 630, packets.end()}, kSensor);
  run.state().data_dropped.store(30);
  CHECK(run.channel().stats().lost_packets == 10);
}

TEST_CASE("packets may gather for nine tenths of a revolution, and none that completes a scan does",
          "[lidar_channel]") {
  ChannelRun run({}, drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16));
  // After the backlog of the start.
  const std::int64_t start_ns = monotonic_ns() + 1'000'000'000;
  std::size_t gathered = 0;
  std::size_t index = 0;
  for (const drivers::Packet& packet : vlp16_packets(3000)) {
    drivers::Packet received = packet;
    received.received_ns = start_ns + static_cast<std::int64_t>(index++) * 1'327'104;
    run.poll();
    const bool may_gather = received.received_ns < run.gather_until_ns.load();
    if (may_gather) ++gathered;
    const std::size_t scans = run.scans.size();
    run.push(received);
    run.poll();
    if (run.scans.size() > scans) CHECK_FALSE(may_gather);
  }
  CHECK(run.scans.size() > 35);
  CHECK(gathered > 2500);
}
