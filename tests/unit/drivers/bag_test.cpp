#include "nilio/drivers/bag/bag.hpp"

#include "nilio/drivers/bag/mcap_writer.hpp"
#include "nilio/drivers/bag/messages.hpp"
#include "nilio/drivers/bag/sources.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "drivers/bag/readers.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"

#include <array>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::drivers;
namespace fs = std::filesystem;

constexpr std::size_t kPackets = 400;
constexpr std::int64_t kFirstNs = 1'700'000'000'000'000'000;
constexpr const char* kPacketTopic = "/velodyne_packets";

/// A capture of random packets and a CAN log: what the writers of the tests read.
class Drive {
 public:
  Drive() {
    std::mt19937 random(7);
    auto writer = PcapWriter::create((folder_.path() / "lidar.pcap").string());
    REQUIRE(writer.ok());
    std::ofstream log(folder_.path() / "imu.candump.log");
    for (std::size_t i = 0; i < kPackets; ++i) {
      std::vector<std::uint8_t> packet(1206);
      // Half of it compresses.
      for (std::size_t k = 0; k < packet.size(); k += 2) packet[k] = static_cast<std::uint8_t>(random());
      const std::int64_t stamp = kFirstNs + static_cast<std::int64_t>(i) * 1'327'104;
      REQUIRE(writer->write({stamp}, 2368, packet));
      packets_.emplace_back(stamp, std::move(packet));
      char line[80];
      std::snprintf(line, sizeof line, "(%lld.%06lld) can0 034#%04zX000009CB\n",
                    static_cast<long long>(stamp / 1'000'000'000),
                    static_cast<long long>(stamp % 1'000'000'000 / 1000), i);
      log << line;
    }
    REQUIRE(writer->close());
  }
  [[nodiscard]] fs::path path(const std::string& name) const { return folder_.path() / name; }
  [[nodiscard]] const auto& packets() const { return packets_; }

  /// False without the writer.
  [[nodiscard]] bool write_rosbag(const std::string& compression) const {
    const std::string command = std::string("/usr/bin/python3 ") + nilio::tests::source_folder() +
                                "/tests/recordings/write_rosbag.py " + folder_.path().string() + " " +
                                path("drive.bag").string() + " " + compression;
    const int status = std::system(command.c_str());
    if (WEXITSTATUS(status) == 77) return false;
    REQUIRE(status == 0);
    return true;
  }

 private:
  tests::TemporaryFolder folder_;
  std::vector<std::pair<std::int64_t, std::vector<std::uint8_t>>> packets_;
};

std::vector<Packet> read_packets(const std::string& file) {
  auto source = open_bag_packets({file}, kPacketTopic);
  REQUIRE(source.ok());
  std::vector<Packet> all;
  std::vector<Packet> slots(64);
  for (SourceRead read = (*source)->read(slots, {}); read.count > 0; read = (*source)->read(slots, {}))
    all.insert(all.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  return all;
}

/// The first packets of the drive, in order and unchanged.
void check_packets(const std::vector<Packet>& packets, const Drive& drive) {
  REQUIRE(packets.size() <= drive.packets().size());
  for (std::size_t i = 0; i < packets.size(); ++i) {
    const auto& [stamp, data] = drive.packets()[i];
    REQUIRE(packets[i].stamp.ns == stamp);
    REQUIRE(packets[i].size == 1206);
    REQUIRE(std::equal(data.begin(), data.end(), packets[i].data.begin()));
  }
}

std::vector<std::uint8_t> read_bytes(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

void write_bytes(const fs::path& path, std::span<const std::uint8_t> bytes) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

std::size_t count_messages(BagReader& reader) {
  std::size_t count = 0;
  while (reader.next()) ++count;
  return count;
}

}  // namespace

TEST_CASE("bags of Debian's rosbag give the packets and frames that were written", "[bag]") {
  const Drive drive;
  for (const char* const compression : {"none", "bz2", "lz4"}) {
    CAPTURE(compression);
    if (!drive.write_rosbag(compression)) {
      WARN("skipped: no python3-rosbag");
      return;
    }
    const std::string file = drive.path("drive.bag").string();
    REQUIRE(is_bag(file));
    const std::vector<Packet> packets = read_packets(file);
    CHECK(packets.size() == kPackets);
    check_packets(packets, drive);
    auto frames = open_bag_frames({file}, "/can0");
    REQUIRE(frames.ok());
    std::vector<CanFrame> slots(2 * kPackets);
    REQUIRE((*frames)->read(slots, {}).count == kPackets);
    CHECK(slots[5].id == 0x34);
    CHECK(slots[5].length == 6);
    CHECK(slots[5].data[1] == 5);
  }
}

TEST_CASE("a bag that was cut anywhere gives the packets before the cut", "[bag]") {
  const Drive drive;
  for (const char* const compression : {"none", "lz4"}) {
    if (!drive.write_rosbag(compression)) {
      WARN("skipped: no python3-rosbag");
      return;
    }
    const std::vector<std::uint8_t> whole = read_bytes(drive.path("drive.bag"));
    std::size_t most = 0;
    for (std::size_t size = 20; size < whole.size(); size += 9973) {
      CAPTURE(compression, size);
      const auto source = bag::open_rosbag1(bag::view_memory(std::span(whole).first(size), "cut"),
                                            [](const BagTopic& topic) { return topic.name == kPacketTopic; });
      if (!source) continue;
      std::vector<Packet> packets;
      while (const auto message = (*source)->next())
        decode_packets((*source)->topics()[message->topic], *message, packets);
      check_packets(packets, drive);
      CHECK(packets.size() >= most);
      most = std::max(most, packets.size());
      CHECK_FALSE((*source)->notes().empty());
    }
  }
}

TEST_CASE("a damaged chunk costs its messages only", "[bag]") {
  const Drive drive;
  if (!drive.write_rosbag("bz2")) {
    WARN("skipped: no python3-rosbag");
    return;
  }
  std::vector<std::uint8_t> bytes = read_bytes(drive.path("drive.bag"));
  std::fill(bytes.begin() + 5000, bytes.begin() + 5100, std::uint8_t{0xFF});
  write_bytes(drive.path("damaged.bag"), bytes);
  CHECK(read_packets(drive.path("damaged.bag").string()).size() < kPackets);
}

TEST_CASE("a recording of the sqlite3 program gives its messages", "[bag]") {
  if (std::system("sqlite3 --version > /dev/null 2>&1") != 0) {
    WARN("skipped: no sqlite3");
    return;
  }
  const tests::TemporaryFolder folder;
  const fs::path file = folder.path() / "drive_0.db3";
  std::ofstream sql(folder.path() / "make.sql");
  sql << "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT "
         "NULL,serialization_format TEXT "
         "NOT NULL,offered_qos_profiles TEXT NOT NULL);\n"
         "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,timestamp INTEGER NOT "
         "NULL,data BLOB "
         "NOT NULL);\n"
         "INSERT INTO topics VALUES(1,'/fix','sensor_msgs/msg/NavSatFix','cdr','');\n"
         "INSERT INTO topics VALUES(2,'/nmea','nmea_msgs/msg/Sentence','cdr','');\n"
         // Stamp 5.000000006 s, frame "g", sentence "$G".
         "INSERT INTO messages(topic_id,timestamp,data) "
         "VALUES(2,1700000000000000000,X'00010000050000000600000002000000"
         "670000000300000024470000');\n";
  sql.close();
  REQUIRE(std::system(("sqlite3 " + file.string() + " < " + (folder.path() / "make.sql").string()).c_str()) ==
          0);
  REQUIRE(is_bag(folder.path().string()));
  const auto files = bag_files(folder.path().string());
  REQUIRE(files.ok());
  auto reader = open_bag(*files);
  REQUIRE(reader.ok());
  const auto message = (*reader)->next();
  REQUIRE(message);
  CHECK(message->stamp.ns == 1'700'000'000'000'000'000);
  const BagTopic& topic = (*reader)->topics()[message->topic];
  CHECK(topic.type == "nmea_msgs/Sentence");
  const auto sentence = decode_sentence(topic, *message);
  REQUIRE(sentence);
  CHECK(sentence->header.stamp.ns == 5'000'000'006);
  CHECK(sentence->header.frame_id == "g");
  CHECK(sentence->sentence == "$G");
  CHECK_FALSE((*reader)->next());
}

TEST_CASE("a db3 file that was cut gives the messages before the cut", "[bag]") {
  const tests::TemporaryFolder folder;
  const std::string file = (folder.path() / "drive_0.db3").string();
  const std::string sql =
      "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT,type TEXT,serialization_format TEXT);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER,timestamp INTEGER,data BLOB);"
      "INSERT INTO topics VALUES(1,'/can','can_msgs/msg/Frame','cdr');"
      "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i+1 FROM n WHERE i<2000) "
      "INSERT INTO messages SELECT i,1,i,randomblob(600) FROM n;";
  if (std::system(("sqlite3 '" + file + "' \"" + sql + "\" 2> /dev/null").c_str()) != 0) {
    WARN("skipped: no sqlite3");
    return;
  }
  fs::resize_file(file, fs::file_size(file) * 6 / 10);
  auto reader = open_bag({file});
  REQUIRE(reader.ok());
  std::size_t messages = 0;
  core::Time last{};
  while (const auto message = (*reader)->next()) {
    CHECK(message->stamp > last);
    last = message->stamp;
    ++messages;
  }
  CHECK(messages > 1000);
  CHECK(messages < 1300);
  REQUIRE((*reader)->notes().size() == 2);
  CHECK_THAT((*reader)->notes().back(), Catch::Contains("messages are read"));
}

TEST_CASE("metadata that leaves its folder is refused", "[bag]") {
  const tests::TemporaryFolder folder;
  for (const char* const path : {"../other.db3", "/etc/passwd"}) {
    std::ofstream(folder.path() / "metadata.yaml")
        << "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - " << path << '\n';
    const auto files = bag_files(folder.path().string());
    REQUIRE_FALSE(files.ok());
    CHECK_THAT(files.error().message, Catch::Contains("outside of its folder"));
  }
}

TEST_CASE("an MCAP file gives its messages, and up to the cut where it is unfinished", "[bag]") {
  const tests::TemporaryFolder folder;
  const fs::path file = folder.path() / "run.mcap";
  constexpr std::size_t kMessages = 3000;
  {
    McapWriter writer(file, {{"/a", "std_msgs/msg/Float64", "float64 data\n"},
                             {"/b", "std_msgs/msg/Float64", "float64 data\n"}});
    std::vector<std::uint8_t> message(1000);
    std::mt19937 random(3);
    for (std::size_t i = 0; i < kMessages; ++i) {
      for (std::uint8_t& byte : message) byte = static_cast<std::uint8_t>(random());
      writer.add(i % 2, {kFirstNs + static_cast<std::int64_t>(i)}, message);
      REQUIRE(writer.file().write_pending() == 0);
    }
    writer.finish();
    REQUIRE(writer.file().write_pending() == 0);
    CHECK(writer.lost() == 0);
  }
  auto whole = open_bag({file.string()});
  REQUIRE(whole.ok());
  CHECK((*whole)->topics().size() == 2);
  CHECK(count_messages(**whole) == kMessages);
  CHECK((*whole)->notes().empty());
  const std::vector<std::uint8_t> bytes = read_bytes(file);
  std::size_t most = 0;
  for (std::size_t size = 8; size < bytes.size(); size += 49'999) {
    CAPTURE(size);
    const auto cut = bag::open_mcap(bag::view_memory(std::span(bytes).first(size), "cut"), {});
    REQUIRE(cut.ok());
    const std::size_t count = count_messages(**cut);
    CHECK(count >= most);
    most = count;
    CHECK_FALSE((*cut)->notes().empty());
  }
  CHECK(most > kMessages / 2);
}

TEST_CASE("declared lengths beyond the file are refused without memory for them", "[bag]") {
  std::vector<std::uint8_t> bytes{0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n', 5};
  bytes.insert(bytes.end(), {0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x7F});
  bytes.resize(40, 1);
  const auto mcap = bag::open_mcap(bag::view_memory(bytes, "lie"), {});
  REQUIRE(mcap.ok());
  CHECK(count_messages(**mcap) == 0);
  CHECK_FALSE((*mcap)->notes().empty());
}

TEST_CASE("recordings of old formats are refused by name", "[bag]") {
  const std::string text = "#ROSBAG V1.2\n and more";
  const std::vector<std::uint8_t> bytes(text.begin(), text.end());
  const auto old = bag::open_rosbag1(bag::view_memory(bytes, "old.bag"), {});
  REQUIRE_FALSE(old.ok());
  CHECK_THAT(old.error().message, Catch::Contains("V1.2") && Catch::Contains("rosbag fix"));
}
