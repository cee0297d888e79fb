#include "tests/support/tools/record_support.hpp"
#include "tools/play/session.hpp"
#include "tools/record/session.hpp"

#include <algorithm>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::play;
using namespace nilio::tools::record;
using tests::TemporaryFolder;

namespace {

RecordConfig record_config(const TemporaryFolder& folder, std::uint16_t data_port,
                           std::uint16_t position_port) {
  RecordConfig config;
  config.folder = folder.path();
  config.bind_address = "127.0.0.1";
  config.data_port = data_port;
  config.position_port = position_port;
  config.priority = 0;
  return config;
}

void check_same(const std::vector<drivers::Packet>& found, const std::vector<drivers::Packet>& wanted) {
  REQUIRE(found.size() == wanted.size());
  for (std::size_t i = 0; i < wanted.size(); ++i)
    CHECK(tests::payload_bytes(found[i]) == tests::payload_bytes(wanted[i]));
}

std::vector<drivers::Packet> to_port(const std::vector<drivers::Packet>& packets, std::uint16_t port) {
  std::vector<drivers::Packet> result;
  std::copy_if(packets.begin(), packets.end(), std::back_inserter(result),
               [&](const drivers::Packet& packet) { return packet.destination_port == port; });
  return result;
}

std::vector<drivers::Packet> read_replay(const std::string& path) {
  const auto files = daemon::find_replay_files({path});
  REQUIRE(files.ok());
  auto input = daemon::open_replay(*files, daemon::Config{});
  REQUIRE(input.ok());
  CHECK(input->sensor->name == "VLP-16");
  return tests::read_all(*input->packets);
}

}  // namespace

TEST_CASE("packets played over loopback are recorded byte for byte, in order and with rising stamps",
          "[record_play]") {
  const TemporaryFolder played;
  const TemporaryFolder recorded;
  const std::uint16_t data_port = tests::free_port();
  const std::uint16_t position_port = tests::free_port();
  const auto packets = tests::sensor_packets(2000, 2368, 8308);
  tests::write_capture(played.path() / "lidar.pcap", packets);

  RecordConfig config = record_config(recorded, data_port, position_port);
  config.limits.rotate_bytes = 300'000;
  auto recording = RecordSession::open(config, [](const std::string& line) { FAIL(line); });
  REQUIRE(recording.ok());
  (*recording)->start();

  PlayConfig play;
  play.captures = {(played.path() / "lidar.pcap").string()};
  play.port = data_port;
  play.position_port = position_port;
  play.speed = 2.0;
  auto playing = PlaySession::open(play, [](const std::string& line) { FAIL(line); });
  REQUIRE(playing.ok());
  CHECK((*playing)->run([] { return false; }).packets == packets.size());
  CHECK(tests::eventually([&] { return (*recording)->progress().received == packets.size(); }));
  (*recording)->stop();

  const RecordProgress progress = (*recording)->progress();
  CHECK(progress.packets == packets.size());
  CHECK(progress.kernel_dropped + progress.ring_dropped + progress.disk_lost == 0);
  CHECK(progress.files >= 9);
  const auto found = tests::read_recording(recorded.text(), data_port, position_port);
  check_same(to_port(found, data_port), to_port(packets, 2368));
  check_same(to_port(found, position_port), to_port(packets, 8308));
  CHECK(std::is_sorted(found.begin(), found.end(),
                       [](const auto& a, const auto& b) { return a.stamp < b.stamp; }));
  for (const drivers::Packet& packet : found) CHECK(packet.sender_address == 0x7F000001);
}

TEST_CASE("the parts of a recording replay like one file with the same packets", "[record_play]") {
  const TemporaryFolder whole;
  const TemporaryFolder parts_folder;
  const auto packets = tests::sensor_packets(1000, 2368, 8308);
  tests::write_capture(whole.path() / "lidar.pcap", packets);
  drivers::RecordCounters counters;
  auto parts = drivers::RecordParts::create(parts_folder.path(), {.rotate_bytes = 100'000}, counters,
                                            [](const std::string& line) { FAIL(line); });
  REQUIRE(parts.ok());
  for (const drivers::Packet& packet : packets) {
    std::vector<std::uint8_t> record;
    REQUIRE(drivers::append_pcap_record(record, packet));
    parts->append(drivers::RecordStream::kLidar, record, 0);
  }
  parts->close(0);
  CHECK(counters.files.load() > 10);
  const auto one = read_replay(whole.text());
  const auto many = read_replay(parts_folder.text());
  CHECK(one.size() == packets.size());
  check_same(many, one);
  for (std::size_t i = 0; i < one.size(); ++i) {
    CHECK(many[i].stamp == one[i].stamp);
    CHECK(many[i].destination_port == one[i].destination_port);
  }
}

TEST_CASE("a file truncated anywhere delivers every packet before the cut", "[record_play]") {
  const TemporaryFolder folder;
  const auto packets = tests::sensor_packets(8, 2368, 8308);
  const auto path = folder.path() / "lidar_0001.pcap";
  tests::write_capture(path, packets);
  const std::uint64_t size = std::filesystem::file_size(path);
  constexpr std::uint64_t kHeader = 24;
  constexpr std::uint64_t kRecord = 16 + 42 + 1206;
  REQUIRE(size == kHeader + 8 * kRecord);
  for (std::uint64_t cut = size; cut >= kHeader + kRecord; cut -= 37) {
    std::filesystem::resize_file(path, cut);
    CHECK(tests::read_recording(folder.text(), 2368).size() == (cut - kHeader) / kRecord);
  }
}
