#include "nilio/drivers/bag/bag.hpp"

#include "drivers/bag/mcap.hpp"
#include "drivers/bag/wire_writer.hpp"
#include "tests/support/temporary_folder.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <random>
#include <string>
#include <vector>
#include <zlib.h>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::drivers;
using bag::WireWriter;
using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kMessages = 200;
// A PointCloud2 of a sensor with 64 beams.
constexpr std::size_t kMessageBytes = std::size_t{1} << 20U;
constexpr double kSmallestMegabytesPerSecond = 200.0;

Bytes noise() {
  Bytes bytes(kMessageBytes);
  std::mt19937 random(5);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random());
  return bytes;
}

void append(std::ofstream& file, const Bytes& bytes) {
  file.write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

template <class T>
std::string raw(T value) {
  Bytes bytes;
  WireWriter(bytes).number(value);
  return {bytes.begin(), bytes.end()};
}

void add_rosbag_record(Bytes& out, const std::vector<std::string>& fields,
                       std::span<const std::uint8_t> data) {
  Bytes header;
  for (const std::string& field : fields) WireWriter(header).text(field);
  WireWriter(out)
      .number(static_cast<std::uint32_t>(header.size()))
      .bytes(header)
      .number(static_cast<std::uint32_t>(data.size()))
      .bytes(data);
}

/// A chunk a message, without compression.
void write_rosbag(const std::string& path) {
  std::ofstream file(path, std::ios::binary);
  file << "#ROSBAG V2.0\n";
  Bytes head;
  add_rosbag_record(head, {"op=\x03", "index_pos=" + raw(std::uint64_t{1})}, {});
  append(file, head);
  const Bytes message = noise();
  for (std::size_t i = 0; i < kMessages; ++i) {
    Bytes type;
    WireWriter(type).text("type=sensor_msgs/PointCloud2");
    const std::string connection = "conn=" + raw(std::uint32_t{0});
    Bytes records;
    add_rosbag_record(records, {"op=\x07", connection, "topic=/points"}, type);
    add_rosbag_record(records, {"op=\x02", connection, "time=" + raw(std::uint64_t{i})}, message);
    Bytes chunk;
    const std::string size = "size=" + raw(static_cast<std::uint32_t>(records.size()));
    add_rosbag_record(chunk, {"op=\x05", "compression=none", size}, records);
    append(file, chunk);
  }
}

void add_mcap_record(Bytes& out, bag::mcap::Op op, const Bytes& content) {
  WireWriter(out).number(static_cast<std::uint8_t>(op)).number(std::uint64_t{content.size()}).bytes(content);
}

void write_mcap(const std::string& path) {
  std::ofstream file(path, std::ios::binary);
  Bytes out(bag::mcap::kMagic.begin(), bag::mcap::kMagic.end());
  Bytes schema;
  WireWriter(schema).number(std::uint16_t{1}).text("sensor_msgs/msg/PointCloud2").text("ros2msg").text("");
  add_mcap_record(out, bag::mcap::kSchema, schema);
  Bytes channel;
  WireWriter(channel)
      .number(std::uint16_t{0})
      .number(std::uint16_t{1})
      .text("/points")
      .text("cdr")
      .number(std::uint32_t{0});
  add_mcap_record(out, bag::mcap::kChannel, channel);
  append(file, out);
  const Bytes data = noise();
  for (std::uint64_t i = 0; i < kMessages; ++i) {
    Bytes message;
    WireWriter(message).number(std::uint16_t{0}).number(std::uint32_t{0}).number(i).number(i).bytes(data);
    Bytes records;
    add_mcap_record(records, bag::mcap::kMessage, message);
    Bytes chunk;
    WireWriter(chunk)
        .number(i)
        .number(i)
        .number(std::uint64_t{records.size()})
        .number(static_cast<std::uint32_t>(crc32_z(0, records.data(), records.size())))
        .text("")
        .number(std::uint64_t{records.size()})
        .bytes(records);
    Bytes record;
    add_mcap_record(record, bag::mcap::kChunk, chunk);
    append(file, record);
  }
}

bool write_db3(const std::string& path) {
  const std::string sql =
      "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT,type TEXT,serialization_format TEXT);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER,timestamp INTEGER,data BLOB);"
      "INSERT INTO topics VALUES(1,'/points','sensor_msgs/msg/PointCloud2','cdr');"
      "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i+1 FROM n WHERE i<" +
      std::to_string(kMessages) + ") INSERT INTO messages SELECT i,1,i,randomblob(" +
      std::to_string(kMessageBytes) + ") FROM n;";
  return std::system(("sqlite3 '" + path + "' \"" + sql + "\" 2> /dev/null").c_str()) == 0;
}

/// Best of five runs, of one thread.
double megabytes_per_second(const std::string& path) {
  double best = 0.0;
  for (int run = 0; run < 5; ++run) {
    const auto start = std::chrono::steady_clock::now();
    const auto reader = open_bag({path});
    REQUIRE(reader.ok());
    std::size_t bytes = 0;
    while (const auto message = (*reader)->next()) bytes += message->data.size();
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    REQUIRE(bytes == kMessages * kMessageBytes);
    best = std::max(best, static_cast<double>(bytes) * 1e-6 / taken.count());
  }
  return best;
}

}  // namespace

// Not part of the suite: a figure of time means nothing on a machine that is busy.
TEST_CASE("recordings without compression are read faster than 200 MB/s", "[.][bag_speed]") {
  const tests::TemporaryFolder folder;
  const auto check = [&](const char* name, const std::string& path) {
    const double speed = megabytes_per_second(path);
    std::cout << name << ": " << std::lround(speed) << " MB/s (" << kMessages
              << " messages of 1 MiB, page cache, one thread)\n";
    CHECK(speed > kSmallestMegabytesPerSecond);
  };
  const std::string rosbag = (folder.path() / "speed.bag").string();
  write_rosbag(rosbag);
  check("rosbag1", rosbag);
  const std::string mcap = (folder.path() / "speed.mcap").string();
  write_mcap(mcap);
  check("MCAP", mcap);
  const std::string db3 = (folder.path() / "speed.db3").string();
  if (write_db3(db3)) {
    check("db3", db3);
  } else {
    WARN("skipped: no sqlite3");
  }
}
