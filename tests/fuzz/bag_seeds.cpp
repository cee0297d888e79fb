#include "tests/fuzz/bag_seeds.hpp"

#include "drivers/bag/mcap.hpp"
#include "drivers/bag/wire_writer.hpp"

#include <bzlib.h>
#include <cstdint>
#include <lz4frame.h>
#include <span>
#include <sqlite3.h>
#include <stdexcept>
#include <string_view>
#include <zlib.h>
#include <zstd.h>

namespace nilio::fuzz {

namespace {

using drivers::bag::WireWriter;
using Bytes = std::vector<std::uint8_t>;

constexpr std::uint32_t kSeconds = 1'700'000'000;
constexpr std::int64_t kFirstStampNs = std::int64_t{kSeconds} * 1'000'000'000;

std::string text_of(std::span<const std::uint8_t> bytes) { return {bytes.begin(), bytes.end()}; }

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

/// Serializes a message as ROS 1 (packed) or as CDR.
class Message {
 public:
  explicit Message(bool is_cdr) : is_cdr_(is_cdr) {
    if (is_cdr_) bytes_ = {0, 1, 0, 0};
  }

  template <class T>
  Message& number(T value) {
    while (is_cdr_ && (bytes_.size() - 4) % sizeof(T) != 0) bytes_.push_back(0);
    WireWriter(bytes_).number(value);
    return *this;
  }
  Message& doubles(std::size_t count) {
    for (std::size_t i = 0; i < count; ++i) number(static_cast<double>(i + 1) / 8.0);
    return *this;
  }
  Message& text(const std::string& value) {
    const std::string content = is_cdr_ ? value + '\0' : value;
    number(static_cast<std::uint32_t>(content.size()));
    return raw(content);
  }
  Message& raw(const std::string& content) {
    WireWriter(bytes_).bytes(bytes_of(content));
    return *this;
  }
  Message& blob(const std::string& content) {
    number(static_cast<std::uint32_t>(content.size()));
    return raw(content);
  }
  Message& header(std::uint32_t nanoseconds) {
    if (!is_cdr_) number(std::uint32_t{7});
    return number(kSeconds).number(nanoseconds).text("velodyne");
  }
  [[nodiscard]] std::string bytes() const { return text_of(bytes_); }

 private:
  bool is_cdr_;
  Bytes bytes_;
};

/// Points with times in nanoseconds from the header's stamp, on two beams.
std::string cloud(bool is_cdr, std::uint32_t number) {
  constexpr std::uint32_t kStep = 18;
  constexpr std::uint32_t kPoints = 24;
  Bytes points;
  for (std::uint32_t i = 0; i < kPoints; ++i)
    WireWriter(points)
        .number(static_cast<float>(i) - 10.0F)
        .number(5.0F)
        .number(static_cast<float>(i % 2))
        .number(i * 4'000'000U)
        .number(static_cast<std::uint16_t>(i % 2));
  Message message(is_cdr);
  message.header(number * 100'000'000).number(std::uint32_t{1}).number(kPoints).number(std::uint32_t{5});
  struct Field {
    const char* name;
    std::uint32_t offset;
    std::uint8_t type;
  };
  for (const Field& field : {Field{"x", 0, 7}, {"y", 4, 7}, {"z", 8, 7}, {"t", 12, 6}, {"ring", 16, 4}})
    message.text(field.name).number(field.offset).number(field.type).number(std::uint32_t{1});
  return message.number(std::uint8_t{0})
      .number(kStep)
      .number(kStep * kPoints)
      .blob(text_of(points))
      .number(std::uint8_t{1})
      .bytes();
}

struct Recorded {
  const char* topic;
  const char* package;
  const char* type;
  std::string data;
};

std::vector<Recorded> messages(bool is_cdr) {
  const auto message = [&] { return Message(is_cdr); };
  std::string packet;
  for (int block = 0; block < 12; ++block) packet += "\xFF\xEE" + std::string(98, static_cast<char>(block));
  packet.resize(1206, '\x21');
  std::vector<Recorded> all;
  for (std::uint32_t i = 0; i < 3; ++i)
    all.push_back({"/points", "sensor_msgs", "PointCloud2", cloud(is_cdr, i)});
  all.push_back({"/imu", "sensor_msgs", "Imu", message().header(1).doubles(37).bytes()});
  all.push_back({"/fix", "sensor_msgs", "NavSatFix",
                 message()
                     .header(2)
                     .number(std::int8_t{0})
                     .number(std::uint16_t{1})
                     .doubles(12)
                     .number(std::uint8_t{2})
                     .bytes()});
  all.push_back({"/nmea", "nmea_msgs", "Sentence", message().header(3).text("$GPGGA").bytes()});
  all.push_back({"/can", "can_msgs", "Frame",
                 message()
                     .header(4)
                     .number(std::uint32_t{0x34})
                     .raw(std::string("\0\0\0\x08"
                                      "abcdefgh",
                                      12))
                     .bytes()});
  all.push_back({"/tf_static", "tf2_msgs", "TFMessage",
                 message()
                     .number(std::uint32_t{1})
                     .header(5)
                     .text("imu")
                     .doubles(3)
                     .number(0.0)
                     .number(0.0)
                     .number(0.0)
                     .number(1.0)
                     .bytes()});
  all.push_back({"/packets", "velodyne_msgs", "VelodyneScan",
                 message()
                     .header(6)
                     .number(std::uint32_t{1})
                     .number(kSeconds)
                     .number(std::uint32_t{6})
                     .raw(packet)
                     .bytes()});
  all.push_back({"/nebula", "nebula_msgs", "NebulaPackets",
                 message()
                     .header(6)
                     .number(std::uint32_t{1})
                     .number(kSeconds)
                     .number(std::uint32_t{6})
                     .blob("packet")
                     .bytes()});
  all.push_back({"/livox", "livox_ros_driver2", "CustomMsg",
                 message()
                     .header(7)
                     .number(static_cast<std::uint64_t>(kFirstStampNs))
                     .number(std::uint32_t{2})
                     .raw(std::string(4, '\0'))
                     .number(std::uint32_t{2})
                     .raw(std::string(39, '\x40'))
                     .bytes()});
  return all;
}

std::string bz2(std::string content) {
  std::string out(content.size() + 1024, '\0');
  auto size = static_cast<unsigned>(out.size());
  if (BZ2_bzBuffToBuffCompress(out.data(), &size, content.data(), static_cast<unsigned>(content.size()), 1, 0,
                               0) != BZ_OK)
    throw std::runtime_error("bz2");
  out.resize(size);
  return out;
}

std::string lz4(const std::string& content) {
  LZ4F_preferences_t preferences{};
  preferences.frameInfo.contentChecksumFlag = LZ4F_contentChecksumEnabled;
  std::string out(LZ4F_compressFrameBound(content.size(), &preferences), '\0');
  const std::size_t size =
      LZ4F_compressFrame(out.data(), out.size(), content.data(), content.size(), &preferences);
  if (LZ4F_isError(size) != 0U) throw std::runtime_error("lz4");
  out.resize(size);
  return out;
}

std::string zstd(const std::string& content) {
  std::string out(ZSTD_compressBound(content.size()), '\0');
  const std::size_t size = ZSTD_compress(out.data(), out.size(), content.data(), content.size(), 1);
  if (ZSTD_isError(size) != 0U) throw std::runtime_error("zstd");
  out.resize(size);
  return out;
}

std::string packed(const std::string& compression, const std::string& content) {
  if (compression == "bz2") return bz2(content);
  if (compression == "lz4") return lz4(content);
  return compression == "zstd" ? zstd(content) : content;
}

template <class T>
std::string number(T value) {
  Bytes bytes;
  WireWriter(bytes).number(value);
  return text_of(bytes);
}

std::string counted(const std::string& content) {
  return number(static_cast<std::uint32_t>(content.size())) + content;
}

std::string rosbag_record(const std::vector<std::string>& fields, const std::string& data) {
  std::string header;
  for (const std::string& field : fields) header += counted(field);
  return counted(header) + counted(data);
}

std::string rosbag(const std::string& compression, bool is_closed) {
  std::string records;
  std::uint32_t connection = 0;
  for (const Recorded& recorded : messages(false)) {
    const std::string id = "conn=" + number(connection++);
    const std::string fields = counted(std::string("type=") + recorded.package + "/" + recorded.type) +
                               counted("md5sum=*") + counted("message_definition=");
    records += rosbag_record({"op=\x07", id, std::string("topic=") + recorded.topic}, fields);
    records += rosbag_record({"op=\x02", id, "time=" + number(kSeconds) + number(connection)}, recorded.data);
  }
  const std::string chunk = is_closed ? packed(compression, records) : std::string();
  std::string file = "#ROSBAG V2.0\n";
  file += rosbag_record({"op=\x03", "index_pos=" + number(std::uint64_t{is_closed ? 1U : 0U}),
                         "conn_count=" + number(connection), "chunk_count=" + number(std::uint32_t{1})},
                        std::string(40, ' '));
  file += rosbag_record({"op=\x05", "compression=" + compression,
                         "size=" + number(is_closed ? static_cast<std::uint32_t>(records.size()) : 0U)},
                        chunk);
  if (!is_closed) return file + records;
  return file + rosbag_record({"op=\x04", "ver=" + number(std::uint32_t{1}),
                               "conn=" + number(std::uint32_t{0}), "count=" + number(std::uint32_t{1})},
                              std::string(12, '\0'));
}

std::string mcap_record(drivers::bag::mcap::Op op, const std::string& content) {
  return std::string(1, static_cast<char>(op)) + number(std::uint64_t{content.size()}) + content;
}

std::string mcap(const std::string& compression, bool has_chunk, bool has_checksum, bool is_cdr) {
  namespace format = drivers::bag::mcap;
  const std::string magic(format::kMagic.begin(), format::kMagic.end());
  const auto crc = [](const std::string& bytes) {
    return static_cast<std::uint32_t>(
        crc32_z(0, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()));
  };
  std::string channels;
  std::string data;
  std::uint16_t id = 0;
  for (const Recorded& recorded : messages(is_cdr)) {
    const std::string type = std::string(recorded.package) + (is_cdr ? "/msg/" : "/") + recorded.type;
    const auto schema = static_cast<std::uint16_t>(id + 1);
    channels += mcap_record(format::kSchema, number(schema) + counted(type) +
                                                 counted(is_cdr ? "ros2msg" : "ros1msg") + counted(""));
    channels += mcap_record(format::kChannel, number(id) + number(schema) + counted(recorded.topic) +
                                                  counted(is_cdr ? "cdr" : "ros1") + counted(""));
    data += mcap_record(format::kMessage, number(id) + number(std::uint32_t{0}) + number(kFirstStampNs + id) +
                                              number(kFirstStampNs + id) + recorded.data);
    ++id;
  }
  std::string file = magic + mcap_record(format::kHeader, counted("ros2") + counted("seed"));
  const std::size_t chunk_start = file.size();
  const std::string records = channels + data;
  if (has_chunk) {
    const std::string chunk = packed(compression, records);
    file += mcap_record(format::kChunk, number(kFirstStampNs) + number(kFirstStampNs + id) +
                                            number(std::uint64_t{records.size()}) +
                                            number(has_checksum ? crc(records) : 0U) + counted(compression) +
                                            number(std::uint64_t{chunk.size()}) + chunk);
  } else {
    file += records;
  }
  file += mcap_record(format::kDataEnd, number(std::uint32_t{0}));
  const std::size_t summary_start = file.size();
  std::string summary = channels;
  if (has_chunk)
    summary += mcap_record(
        format::kChunkIndex,
        number(kFirstStampNs) + number(kFirstStampNs + id) + number(std::uint64_t{chunk_start}) +
            number(std::uint64_t{summary_start - chunk_start}) + counted("") + number(std::uint64_t{0}) +
            counted(compression) + number(std::uint64_t{1}) + number(std::uint64_t{1}));
  summary += std::string(1, static_cast<char>(format::kFooter)) +
             number(std::uint64_t{format::kFooterContent}) + number(std::uint64_t{summary_start}) +
             number(std::uint64_t{0});
  return file + summary + number(has_checksum ? crc(summary) : 0U) + magic;
}

void run(sqlite3* database, const std::string& sql) {
  if (sqlite3_exec(database, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    throw std::runtime_error(sqlite3_errmsg(database));
}

std::string db3(bool is_compressed) {
  sqlite3* database = nullptr;
  if (sqlite3_open(":memory:", &database) != SQLITE_OK) throw std::runtime_error("sqlite3");
  run(database,
      "PRAGMA page_size=1024; CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT,type TEXT,"
      "serialization_format TEXT,offered_qos_profiles TEXT);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER,timestamp INTEGER,data BLOB)");
  int id = 0;
  for (const Recorded& recorded : messages(true)) {
    ++id;
    run(database, "INSERT INTO topics VALUES(" + std::to_string(id) + ",'" + recorded.topic + "','" +
                      recorded.package + "/msg/" + recorded.type + "','cdr','')");
    const std::string data = is_compressed ? zstd(recorded.data) : recorded.data;
    constexpr std::string_view kHex = "0123456789ABCDEF";
    std::string hex;
    for (const char c : data) hex += {kHex[static_cast<std::uint8_t>(c) >> 4U], kHex[c & 15]};
    run(database, "INSERT INTO messages(topic_id,timestamp,data) VALUES(" + std::to_string(id) + "," +
                      std::to_string(kFirstStampNs + id) + ",X'" + hex + "')");
  }
  sqlite3_int64 size = 0;
  unsigned char* const image = sqlite3_serialize(database, "main", &size, 0);
  const std::string bytes(reinterpret_cast<const char*>(image), static_cast<std::size_t>(size));
  sqlite3_free(image);
  sqlite3_close(database);
  return bytes;
}

}  // namespace

std::vector<BagSeed> rosbag1_seeds() {
  std::vector<BagSeed> seeds;
  for (const char* const compression : {"none", "bz2", "lz4"}) {
    seeds.push_back({compression, rosbag(compression, true)});
    seeds.push_back({std::string(compression) + "_open", rosbag(compression, false)});
  }
  return seeds;
}

std::vector<BagSeed> mcap_seeds() {
  std::vector<BagSeed> seeds{{"unchunked", mcap("", false, false, true)},
                             {"ros1", mcap("", true, false, false)}};
  for (const char* const compression : {"", "lz4", "zstd"}) {
    const std::string name = std::string("chunk_") + compression;
    seeds.push_back({name, mcap(compression, true, true, true)});
    seeds.push_back({name + "_unchecked", mcap(compression, true, false, true)});
  }
  return seeds;
}

std::vector<BagSeed> db3_seeds() { return {{"plain", db3(false)}, {"zstd", db3(true)}}; }

}  // namespace nilio::fuzz
