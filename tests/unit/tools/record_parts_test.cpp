#include "nilio/drivers/capture/record_parts.hpp"

#include "tests/support/tools/record_support.hpp"
#include "tools/record/channel.hpp"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sys/mount.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::record;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using tests::count_up;
using tests::numbers_of;
using tests::read_recording;
using tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

constexpr std::uint16_t kPort = 2368;

std::vector<std::uint8_t> numbered_record(std::uint32_t number) {
  std::vector<std::uint8_t> record;
  REQUIRE(drivers::append_pcap_record(record, {tests::kEpochNs + number * 1000LL},
                                      {.destination_port = kPort}, tests::numbered_payload(number)));
  return record;
}

std::vector<std::string> file_names(const fs::path& folder) {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder)) names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

struct Parts {
  Parts(const fs::path& folder, const RecordLimits& limits)
      : created(RecordParts::create(folder, limits, counters,
                                    [this](const std::string& line) { lines.push_back(line); })) {
    REQUIRE(created.ok());
  }
  RecordParts* operator->() { return &created.value(); }

  RecordCounters counters;
  std::vector<std::string> lines;
  core::Result<RecordParts> created;
};

/// Source with ascending slots that then ends.
class CountingSource final : public drivers::PacketSource {
 public:
  CountingSource(std::int64_t first_ns, std::int64_t step_ns, std::size_t count)
      : next_ns_(first_ns), step_ns_(step_ns), left_(count) {}
  drivers::SourceRead read(std::span<drivers::Packet> slots, core::Duration /*timeout*/) override {
    const std::size_t count = std::min(slots.size(), left_);
    for (drivers::Packet& slot : slots.first(count)) {
      slot.stamp.ns = next_ns_;
      slot.received_ns = next_ns_;
      next_ns_ += step_ns_;
    }
    left_ -= count;
    return {count > 0 ? drivers::SourceState::kData : drivers::SourceState::kEnd, count};
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return {}; }
  [[nodiscard]] std::string status() const override { return "counting"; }

 private:
  std::int64_t next_ns_;
  std::int64_t step_ns_;
  std::size_t left_;
};

}  // namespace

TEST_CASE("rotation by size stores every packet exactly once and limits the size of parts",
          "[record_parts]") {
  const TemporaryFolder folder;
  Parts parts(folder.path(), {.rotate_bytes = 20'000, .keep = 0});
  for (std::uint32_t i = 0; i < 500; ++i) parts->append(RecordStream::kLidar, numbered_record(i), i);
  parts->close(500);
  CHECK(numbers_of(read_recording(folder.text(), kPort)) == count_up(500));
  CHECK(parts.counters.written[0].load() == 500);
  CHECK(parts.counters.files.load() == file_names(folder.path()).size());
  CHECK(file_names(folder.path()).size() == 34);  // 15 packets of 1264 bytes in each
  std::uint64_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(folder.path())) {
    CHECK(entry.file_size() <= 20'000);
    bytes += entry.file_size();
  }
  CHECK(parts.counters.bytes.load() == bytes);
  CHECK(parts.lines.empty());
}

TEST_CASE("rotation by time limits the age of parts, and both files of a part have its number",
          "[record_parts]") {
  const TemporaryFolder folder;
  Parts parts(folder.path(), {.rotate_after = {10'000'000'000}});
  const std::vector<std::uint8_t> line(40, 'x');
  for (std::uint32_t second = 0; second < 25; ++second) {
    parts->append(RecordStream::kLidar, numbered_record(second), second * 1'000'000'000LL);
    if (second >= 10) parts->append(RecordStream::kCan, line, second * 1'000'000'000LL);
  }
  parts->close(25'000'000'000LL);
  CHECK(file_names(folder.path()) == std::vector<std::string>{"can_0002.log", "can_0003.log",
                                                              "lidar_0001.pcap", "lidar_0002.pcap",
                                                              "lidar_0003.pcap"});
  CHECK(numbers_of(read_recording((folder.path() / "lidar_0002.pcap").string(), kPort)) ==
        std::vector<std::uint32_t>{10, 11, 12, 13, 14, 15, 16, 17, 18, 19});
  CHECK(fs::file_size(folder.path() / "can_0002.log") == 400);
}

TEST_CASE("recording into a folder with recordings continues the numbers and overwrites no file",
          "[record_parts]") {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "lidar_0007.pcap") << "old";
  std::ofstream(folder.path() / "can_0009.log") << "old";
  std::ofstream(folder.path() / "lidar_0042.pcap.bak") << "something else";
  Parts parts(folder.path(), {.rotate_bytes = 2'000});
  parts->append(RecordStream::kLidar, numbered_record(0), 0);
  // Another program uses the next number meanwhile.
  std::ofstream(folder.path() / "lidar_0011.pcap") << "foreign";
  parts->append(RecordStream::kLidar, numbered_record(1), 1);
  parts->close(2);
  CHECK(fs::exists(folder.path() / "lidar_0010.pcap"));
  CHECK(fs::exists(folder.path() / "lidar_0012.pcap"));
  CHECK(tests::read_file(folder.path() / "lidar_0007.pcap") == "old");
  CHECK(tests::read_file(folder.path() / "can_0009.log") == "old");
  CHECK(tests::read_file(folder.path() / "lidar_0011.pcap") == "foreign");
  CHECK(parts.counters.written[0].load() == 2);
}

TEST_CASE("only the newest parts are kept, including those of earlier recordings", "[record_parts]") {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "lidar_0001.pcap") << "old";
  std::ofstream(folder.path() / "can_0001.log") << "old";
  std::ofstream(folder.path() / "notes.txt") << "mine";
  Parts parts(folder.path(), {.rotate_bytes = 2'000, .keep = 3});
  CHECK(fs::exists(folder.path() / "lidar_0001.pcap"));
  for (std::uint32_t i = 0; i < 6; ++i) parts->append(RecordStream::kLidar, numbered_record(i), i);
  parts->close(6);
  CHECK(file_names(folder.path()) ==
        std::vector<std::string>{"lidar_0005.pcap", "lidar_0006.pcap", "lidar_0007.pcap", "notes.txt"});
  CHECK(numbers_of(read_recording(folder.text(), kPort)) == std::vector<std::uint32_t>{3, 4, 5});
  CHECK(parts.counters.deleted.load() == 5);
}

TEST_CASE("a recording without data leaves no file", "[record_parts]") {
  const TemporaryFolder folder;
  Parts parts(folder.path() / "new" / "folder", {});
  parts->flush(0);
  parts->close(0);
  CHECK(file_names(folder.path() / "new" / "folder").empty());
}

TEST_CASE("a folder that cannot be created is named in the error", "[record_parts]") {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "file") << "x";
  RecordCounters counters;
  const auto parts =
      RecordParts::create(folder.path() / "file" / "run", {}, counters, [](const std::string&) {});
  REQUIRE_FALSE(parts.ok());
  CHECK_THAT(parts.error().message, Contains("file/run") && Contains("could not be created"));
}

TEST_CASE("a full disk is reported once, drops data that do not fit, and recording continues with free space",
          "[record_parts]") {
  const TemporaryFolder folder;
  if (mount("nilio-test", folder.path().c_str(), "tmpfs", 0, "size=2m") != 0) {
    WARN("skipped: no file system of its own can be mounted (" << std::strerror(errno) << ")");
    return;
  }
  const fs::path filler = folder.path() / "filler";
  std::ofstream(filler, std::ios::binary) << std::string(1'000'000, 'x');
  {
    Parts parts(folder.path(), {});
    std::uint32_t number = 0;
    std::int64_t now = 0;
    const auto record = [&](int packets) {
      for (int i = 0; i < packets; ++i) parts->append(RecordStream::kLidar, numbered_record(number++), now);
      parts->flush(now);
      now += 1'000'000'000;
    };
    for (int i = 0; i < 100; ++i) record(100);  // 12.6 MB
    CHECK(parts.counters.blocked.load());
    CHECK(parts.counters.lost[0].load() > 0);
    REQUIRE(parts.lines.size() == 1);
    CHECK_THAT(parts.lines[0],
               Contains("lidar_0001.pcap") && Contains("No space left") && Contains("free space"));
    fs::remove(filler);
    REQUIRE(mount("nilio-test", folder.path().c_str(), "tmpfs", MS_REMOUNT, "size=64m") == 0);
    record(100);
    CHECK_FALSE(parts.counters.blocked.load());
    REQUIRE(parts.lines.size() == 2);
    CHECK_THAT(parts.lines[1], Contains("writable again") &&
                                   Contains(std::to_string(parts.counters.lost[0].load()) + " records"));
    record(100);
    parts->close(now);
    CHECK(parts.counters.written[0].load() + parts.counters.lost[0].load() == number);
    // Only whole records, in order, without the dropped ones.
    const auto numbers = numbers_of(read_recording((folder.path() / "lidar_0001.pcap").string(), kPort));
    CHECK(numbers.size() == parts.counters.written[0].load());
    CHECK(std::is_sorted(numbers.begin(), numbers.end()));
    CHECK(std::adjacent_find(numbers.begin(), numbers.end()) == numbers.end());
    CHECK(numbers.back() == number - 1);
  }
  CHECK(umount(folder.path().c_str()) == 0);
}

TEST_CASE("packets of several sockets are merged in the order of their stamps up to the horizon",
          "[record_parts]") {
  std::vector<std::unique_ptr<RecordChannel<drivers::Packet>>> channels;
  const auto add = [&](std::int64_t first, std::int64_t step, std::size_t count) {
    channels.push_back(std::make_unique<RecordChannel<drivers::Packet>>(
        std::make_unique<CountingSource>(first, step, count), 128));
    receive_into_ring(*channels.back(), std::atomic<bool>{false});
  };
  add(0, 10, 100);
  add(5, 140, 7);
  RingMerger<drivers::Packet> merger(channels);
  std::vector<std::int64_t> stamps;
  const auto collect = [&](const drivers::Packet& packet, std::size_t channel) {
    CHECK((packet.stamp.ns % 10 == 5) == (channel == 1));
    stamps.push_back(packet.stamp.ns);
  };
  merger.drain({.stamp = {500}, .received_ns = -1}, collect);
  CHECK(stamps.size() == 51 + 4);
  // The clock was set back: packets received long ago are delivered regardless of their stamp.
  merger.drain({.stamp = {0}, .received_ns = 600}, collect);
  CHECK(stamps.size() == 61 + 5);
  merger.drain({.stamp = {2000}, .received_ns = -1}, collect);
  CHECK(stamps.size() == 107);
  CHECK(std::is_sorted(stamps.begin(), stamps.end()));
}

TEST_CASE("packets that find the ring full are read from the source, dropped and counted", "[record_parts]") {
  RecordChannel<drivers::Packet> channel(std::make_unique<CountingSource>(0, 1, 1000), 128);
  receive_into_ring(channel, std::atomic<bool>{false});
  CHECK(channel.ring.size() == 128);
  CHECK(channel.ring.dropped() == 872);
}
