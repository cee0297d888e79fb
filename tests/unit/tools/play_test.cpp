#include "nilio/drivers/network/udp.hpp"

#include "tests/support/tools/record_support.hpp"
#include "tools/play/session.hpp"
#include "tools/play/timeline.hpp"

#include <cstring>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::play;
using Catch::Matchers::Contains;
using tests::kEpochNs;
using tests::TemporaryFolder;
using Event = PlayTimeline::Event;

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

core::Time at(double seconds) { return core::Time{kEpochNs} + core::Duration::from_seconds(seconds); }

std::uint32_t sensor_time_us(const drivers::Packet& packet) {
  std::uint32_t time = 0;
  std::memcpy(&time, packet.data.data() + (packet.size == 1206 ? 1200 : 198), sizeof(time));
  return time;
}

drivers::Packet packet_at(std::uint32_t sensor_us, std::uint16_t size) {
  drivers::Packet packet;
  packet.size = size;
  packet.data.fill(0x5A);
  std::memcpy(packet.data.data() + (size == 1206 ? 1200 : 198), &sensor_us, sizeof(sensor_us));
  return packet;
}

PlayConfig config_for(const TemporaryFolder& folder, std::uint16_t data_port, std::uint16_t position_port) {
  PlayConfig config;
  const auto files = daemon::sort_replay_files({folder.text()});
  REQUIRE(files.ok());
  config.captures = files->captures;
  config.can_logs = files->can_logs;
  config.port = data_port;
  config.position_port = position_port;
  return config;
}

bool never_stop() { return false; }

/// Source that received all packets without loss.
std::vector<drivers::Packet> receive_all(drivers::PacketSource& source, std::size_t count) {
  std::vector<drivers::Packet> packets;
  std::array<drivers::Packet, 64> slots;
  while (packets.size() < count) {
    const auto read = source.read(slots, {2 * kSecond});
    if (read.state != drivers::SourceState::kData) break;
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  }
  return packets;
}

}  // namespace

TEST_CASE("due times have the recorded distances divided by the speed, relative to one origin", "[play]") {
  PlayTimeline timeline(4.0, {10 * kSecond});
  CHECK(timeline.next(at(0), 1000).due_ns == 1000);
  // The current time has no effect, so that delays do not accumulate.
  for (int i = 1; i < 10'000; ++i) {
    const auto due = timeline.next({kEpochNs + i * 1'326'000LL}, 7 * kSecond + i);
    CHECK(due.event == Event::kNone);
    CHECK(due.due_ns == 1000 + i * 331'500LL);
  }
}

TEST_CASE("reordered packets are due at once and do not affect the others", "[play]") {
  PlayTimeline timeline(1.0, {10 * kSecond});
  timeline.next(at(0), 0);
  CHECK(timeline.next(at(0.5), 0).due_ns == kSecond / 2);
  const auto early = timeline.next(at(0.1), 0);
  CHECK(early.event == Event::kNone);
  CHECK(early.due_ns == kSecond / 2);
  CHECK(timeline.next(at(0.6), 0).due_ns == 600'000'000);
}

TEST_CASE("gaps are kept up to the maximum and skipped beyond it", "[play]") {
  PlayTimeline timeline(1.0, {10 * kSecond});
  timeline.next(at(0), 0);
  const auto waited = timeline.next(at(9), 0);
  CHECK(waited.event == Event::kGap);
  CHECK(waited.due_ns == 9 * kSecond);
  const auto skipped = timeline.next(at(100), 9 * kSecond + 5);
  CHECK(skipped.event == Event::kGapSkipped);
  CHECK(skipped.step.seconds() == 91.0);
  CHECK(skipped.due_ns == 9 * kSecond + 5);
  CHECK(timeline.next(at(101), 0).due_ns == 10 * kSecond + 5);
}

TEST_CASE("playing continues after stamps that jump back", "[play]") {
  PlayTimeline timeline(1.0, {10 * kSecond});
  timeline.next(at(0), 0);
  timeline.next(at(3), 3 * kSecond);
  const auto back = timeline.next(at(1), 3 * kSecond);
  CHECK(back.event == Event::kBackwards);
  CHECK(back.is_new_origin());
  CHECK(back.due_ns == 3 * kSecond);
  CHECK(timeline.next(at(1.5), 0).due_ns == 3 * kSecond + kSecond / 2);
  timeline.restart();
  CHECK(timeline.next(at(0), 0).due_ns == 3 * kSecond + kSecond / 2);
}

TEST_CASE("restamping moves data and position packets by one constant, also across the hour", "[play]") {
  Restamper restamper;
  drivers::Packet first = packet_at(3'599'000'000, 1206);
  // Shortly after 22:13:20.
  restamper.apply(first, {kEpochNs + 123'456'000});
  CHECK(sensor_time_us(first) == 800'123'456);
  drivers::Packet position = packet_at(500'000, 512);  // 1.5 s later, past the hour
  restamper.apply(position, {kEpochNs + 99 * kSecond});
  CHECK(sensor_time_us(position) == 801'623'456);
  drivers::Packet beyond = packet_at(3'600'500'000, 1206);  // sensors count a little beyond the hour
  restamper.apply(beyond, {0});
  CHECK(sensor_time_us(beyond) == 801'623'456);
  for (std::size_t i = 0; i < 1206; ++i) {
    if (i < 1200 || i > 1203) CHECK(beyond.data[i] == 0x5A);
  }
  drivers::Packet other = packet_at(1, 512);
  other.size = 600;
  const auto before = other.data;
  restamper.apply(other, {0});
  CHECK(other.data == before);
  restamper.restart();
  drivers::Packet again = packet_at(7, 1206);
  restamper.apply(again, {kEpochNs});
  CHECK(sensor_time_us(again) == 800'000'000);
}

TEST_CASE("at speed 4 the data and position packets of a capture arrive complete and in order", "[play]") {
  const TemporaryFolder folder;
  const auto packets = tests::sensor_packets(1500, 2368, 8308);
  tests::write_capture(folder.path() / "lidar.pcap", packets);
  const std::uint16_t port = tests::free_port();
  auto source = drivers::open_udp({.bind_address = "127.0.0.1", .port = port, .position_port = 0});
  REQUIRE(source.ok());
  PlayConfig config = config_for(folder, port, port);
  config.speed = 4.0;
  auto session = PlaySession::open(config, [](const std::string& line) { FAIL(line); });
  REQUIRE(session.ok());
  PlayReport report;
  const auto begun = std::chrono::system_clock::now().time_since_epoch();
  std::thread player([&] { report = (*session)->run(never_stop); });
  const auto received = receive_all(**source, packets.size());
  player.join();
  CHECK(report.packets == packets.size());
  CHECK(report.packets_failed == 0);
  CHECK(report.loops == 1);
  CHECK(report.late_max_ns >= report.late_p50_ns);
  REQUIRE(received.size() == packets.size());
  for (std::size_t i = 0; i < packets.size(); ++i)
    CHECK(tests::payload_bytes(received[i]) == tests::payload_bytes(packets[i]));
  // Paced, not sent at once: the last packet arrives a quarter of the recording after the start, or later.
  const core::Duration recorded = packets.back().stamp - packets.front().stamp;
  CHECK((received.back().stamp.ns - std::chrono::nanoseconds(begun).count()) * 4 >= recorded.ns);
}

TEST_CASE("looping repeats the recording, and restamped packets continue the clock", "[play]") {
  const TemporaryFolder folder;
  const auto packets = tests::sensor_packets(100, 2368, 8308);
  tests::write_capture(folder.path() / "lidar.pcap", packets);
  const std::uint16_t port = tests::free_port();
  auto source = drivers::open_udp({.bind_address = "127.0.0.1", .port = port, .position_port = 0});
  REQUIRE(source.ok());
  PlayConfig config = config_for(folder, port, port);
  config.loops = 3;
  config.restamp = true;
  auto session = PlaySession::open(config, [](const std::string&) {});
  REQUIRE(session.ok());
  const PlayReport report = (*session)->run(never_stop);
  CHECK(report.loops == 3);
  CHECK(report.packets == 3 * packets.size());
  const auto received = receive_all(**source, 3 * packets.size());
  REQUIRE(received.size() == 3 * packets.size());
  // The sensor's time of each loop's first packet is the host's, slightly before its arrival.
  for (std::size_t loop = 0; loop < 3; ++loop) {
    const drivers::Packet& first = received[loop * packets.size()];
    const std::int64_t arrived_us = first.stamp.ns / 1000 % 3'600'000'000;
    const std::int64_t behind = (arrived_us - sensor_time_us(first) + 3'600'000'000) % 3'600'000'000;
    CHECK(behind < 60'000'000);
  }
}

TEST_CASE("broadcast and multicast packets reach their receivers", "[play]") {
  const TemporaryFolder folder;
  const auto packets = tests::sensor_packets(20, 2368, 8308);
  tests::write_capture(folder.path() / "lidar.pcap", packets);
  const int listener = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  socklen_t length = sizeof(address);
  REQUIRE(bind(listener, reinterpret_cast<const sockaddr*>(&address), length) == 0);
  REQUIRE(getsockname(listener, reinterpret_cast<sockaddr*>(&address), &length) == 0);
  ip_mreq group{};
  inet_pton(AF_INET, "239.255.23.68", &group.imr_multiaddr);
  inet_pton(AF_INET, "127.0.0.1", &group.imr_interface);
  REQUIRE(setsockopt(listener, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof(group)) == 0);
  for (const char* destination : {"127.255.255.255", "239.255.23.68"}) {
    PlayConfig config = config_for(folder, ntohs(address.sin_port), ntohs(address.sin_port));
    config.sender = {.destination_address = destination, .local_address = "127.0.0.1"};
    config.fast = true;
    auto session = PlaySession::open(config, [](const std::string& line) { FAIL(line); });
    REQUIRE(session.ok());
    CHECK((*session)->run(never_stop).packets == packets.size());
    std::array<std::uint8_t, 2000> bytes;
    std::size_t received = 0;
    CHECK(tests::eventually([&] {
      while (recv(listener, bytes.data(), bytes.size(), MSG_DONTWAIT) > 0) ++received;
      return received >= packets.size();
    }));
    CHECK(received == packets.size());
  }
  close(listener);
}

TEST_CASE("jumps in the stamps of a recording are reported with their position", "[play]") {
  const TemporaryFolder folder;
  std::vector<drivers::Packet> packets(3);
  const double times[] = {0.0, 100.0, 50.0};
  for (std::size_t i = 0; i < 3; ++i) {
    packets[i].stamp = at(times[i]);
    packets[i].destination_port = 2368;
    packets[i].size = 10;
  }
  tests::write_capture(folder.path() / "lidar.pcap", packets);
  std::vector<std::string> lines;
  auto session = PlaySession::open(config_for(folder, tests::free_port(), 0),
                                   [&](const std::string& line) { lines.push_back(line); });
  REQUIRE(session.ok());
  CHECK((*session)->run(never_stop).packets == 3);
  REQUIRE(lines.size() == 2);
  CHECK_THAT(lines[0], Contains("100.000 s after") && Contains("gap of 100.000 s"));
  CHECK_THAT(lines[1], Contains("50.000 s after") && Contains("jump back by 50.000 s"));
}

TEST_CASE("playing stops on request, also within a gap", "[play]") {
  const TemporaryFolder folder;
  auto packets = tests::sensor_packets(2, 2368, 8308);
  packets[1].stamp = packets[0].stamp + core::Duration{3600 * kSecond};
  tests::write_capture(folder.path() / "lidar.pcap", packets);
  PlayConfig config = config_for(folder, tests::free_port(), 0);
  config.longest_gap = {7200 * kSecond};
  auto session = PlaySession::open(config, [](const std::string&) {});
  REQUIRE(session.ok());
  int asked = 0;
  const PlayReport report = (*session)->run([&] { return ++asked > 3; });
  CHECK(report.packets == 1);
  CHECK(report.loops == 0);
}

TEST_CASE("errors of playing name the option and the remedy", "[play]") {
  const TemporaryFolder folder;
  tests::write_capture(folder.path() / "lidar.pcap", tests::sensor_packets(5, 2368, 8308));
  const PlayConfig good = config_for(folder, 0, 0);
  const auto error_of = [](const PlayConfig& config) {
    const auto session = PlaySession::open(config, [](const std::string&) {});
    REQUIRE_FALSE(session.ok());
    return session.error().message;
  };
  PlayConfig config = good;
  config.sender.destination_address = "lidar";
  CHECK_THAT(error_of(config), Contains("--to: 'lidar' is no IPv4 address"));
  config = good;
  config.sender.local_address = "203.0.113.7";
  CHECK_THAT(error_of(config), Contains("--from 203.0.113.7") && Contains("ip -4 address"));
  config = good;
  config.restamp = true;
  config.speed = 2.0;
  CHECK_THAT(error_of(config), Contains("--restamp needs the recording's own pace"));
  config = good;
  config.can_interface = "can0";
  CHECK_THAT(error_of(config), Contains("no CAN log"));
  config = good;
  config.recorded_port = 1;
  config.recorded_position_port = 2;
  CHECK_THAT(error_of(config), Contains("2368"));
  CHECK_THAT(error_of({}), Contains("no input to play"));
  config = {};
  config.can_logs = {"can_0001.log"};
  CHECK_THAT(error_of(config), Contains("CAN logs need --can"));
}
