// Writes the seed inputs of the fuzz targets: "fuzz_seeds FOLDER SOURCES" makes one folder per target.

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "drivers/velodyne/calibration/calibration_fields.hpp"
#include "tests/fuzz/bag_seeds.hpp"
#include "tests/fuzz/fuzz_support.hpp"
#include "tests/support/capture_bytes.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <span>
#include <string>

namespace nilio::fuzz {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kStampNs = 1'700'000'000'000'000'123;
constexpr std::uint16_t kDataPort = 2368;

/// Inputs of one target, and next to the folder their list for -seed_inputs.
class SeedFolder {
 public:
  SeedFolder(const fs::path& root, const std::string& target) : folder_(root / target) {
    fs::create_directories(folder_);
  }
  SeedFolder(const SeedFolder&) = delete;
  SeedFolder& operator=(const SeedFolder&) = delete;
  void write_list() const {
    std::string list;
    for (const auto& entry : fs::directory_iterator(folder_)) {
      list += (list.empty() ? "" : ",") + entry.path().string();
    }
    std::ofstream(folder_.string() + ".list") << list;
  }
  void add(const std::string& name, const std::string& content) const {
    std::ofstream file(folder_ / name, std::ios::binary);
    file << content;
    if (!file.flush()) throw fs::filesystem_error("cannot write", folder_ / name, {});
  }
  /// Copies the files in `from`.
  void add_files(const fs::path& from) const {
    for (const auto& entry : fs::directory_iterator(from)) {
      std::ifstream file(entry.path(), std::ios::binary);
      add(entry.path().filename().string(), {std::istreambuf_iterator<char>(file), {}});
    }
  }
  [[nodiscard]] fs::path path(const std::string& name) const { return folder_ / name; }

 private:
  fs::path folder_;
};

/// A data packet of a layout with equal distances.
std::string data_packet(const drivers::VelodyneSensor& sensor, const drivers::PacketLayout& layout,
                        std::uint16_t azimuth) {
  drivers::VelodyneDataPacket packet;
  for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
    packet.blocks[b].flag = layout.block_flags[b];
    packet.blocks[b].azimuth = static_cast<std::uint16_t>(azimuth + 40 * (b / layout.blocks_per_azimuth));
    for (auto& entry : packet.blocks[b].entries) entry = {6000, 50};
  }
  packet.timestamp_us = 800'000'000;
  packet.factory_byte_1 = layout.return_mode_byte;
  packet.factory_byte_2 = sensor.product_byte;
  const auto bytes = drivers::encode(packet);
  return {bytes.begin(), bytes.end()};
}

std::string record(PacketRecord kind) { return {static_cast<char>(kind)}; }

std::string turn(std::uint8_t count, std::uint16_t advance, std::int16_t clock_error) {
  return record(PacketRecord::kTurn) + static_cast<char>(count) +
         tests::ByteText(false).u16(advance).u16(static_cast<std::uint16_t>(clock_error)).bytes();
}

std::string raw(const std::string& payload) {
  return record(PacketRecord::kRaw) +
         tests::ByteText(false).u16(500).u16(payload.size()).text(payload).bytes();
}

void write_packet_seeds(const SeedFolder& folder) {
  for (const drivers::VelodyneModel model : drivers::velodyne_models()) {
    const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
    for (std::size_t mode = 0; mode < sensor.layouts.size(); ++mode) {
      const drivers::PacketLayout& layout = sensor.layouts[mode];
      const auto model_number = static_cast<char>(model);
      const auto time_source = static_cast<char>((static_cast<std::size_t>(model) + mode) % 3);
      const std::string head{model_number, time_source, static_cast<char>(mode), '\0', '\x80', '\x80'};
      const std::string name = std::to_string(model_number) + "_" + std::to_string(mode);
      const std::string again = record(PacketRecord::kAgain) + std::string("\x02\x00\x07", 3);
      const std::string clock =
          record(PacketRecord::kClock) + tests::ByteText(false).u32(3'599'990'000).u32(2'000'000).bytes();
      folder.add("turn_" + name, head + turn(200, 40, 0) + turn(200, 40, 3));
      folder.add("fast_" + name, head + turn(90, 700, 0) + again + again + turn(90, 700, -400));
      folder.add("clock_" + name, head + turn(60, 300, 0) + clock + turn(60, 300, 0));
      folder.add("raw_" + name, head + raw(data_packet(sensor, layout, 100)) + raw(std::string(512, '\0')) +
                                    raw(data_packet(sensor, layout, 35700)) + raw("short"));
    }
  }
}

/// A db.xml of the sensor's lasers.
std::string db_xml(const drivers::VelodyneSensor& sensor) {
  const auto tag = [](const std::string& name, const std::string& content) {
    return "<" + name + ">" + content + "</" + name + ">\n";
  };
  std::string points;
  for (std::size_t id = 0; id < sensor.lasers.size(); ++id) {
    std::string fields = tag("id_", std::to_string(id));
    for (const drivers::CalibrationField& field : drivers::kCalibrationFields) {
      const double unit = field.quantity == drivers::Quantity::kAngle    ? drivers::kXmlUnits.angle
                          : field.quantity == drivers::Quantity::kLength ? drivers::kXmlUnits.length
                                                                         : 1.0;
      fields += tag(field.xml_key, drivers::format_number(sensor.lasers[id].*field.target / unit));
    }
    points += tag("item", tag("px", fields));
  }
  return tag("boost_serialization", tag("DB", tag("points_", points)));
}

/// Input of fuzz_calibration: model, then a file. Small models, because the length decides the speed.
void write_calibration_seeds(const SeedFolder& folder) {
  for (const drivers::VelodyneModel model :
       {drivers::VelodyneModel::kVlp16, drivers::VelodyneModel::kPuckHiRes,
        drivers::VelodyneModel::kHdl32e}) {
    const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(model);
    const std::string head{static_cast<char>(model)};
    folder.add(sensor.name + ".xml", head + db_xml(sensor));
    const std::string file = folder.path("file").string();
    if (const auto written = drivers::write_calibration_yaml(sensor, file); !written)
      throw std::runtime_error(written.error().message);
    std::ifstream yaml(file, std::ios::binary);
    folder.add(sensor.name + ".yaml", head + std::string{std::istreambuf_iterator<char>(yaml), {}});
    fs::remove(file);
  }
}

void write_capture_seeds(const SeedFolder& folder) {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  const std::string data = data_packet(sensor, sensor.single(), 0);
  auto writer = drivers::PcapWriter::create(folder.path("writer").string());
  if (!writer) throw std::runtime_error(writer.error().message);
  const std::span bytes(reinterpret_cast<const std::uint8_t*>(data.data()), data.size());
  for (int i = 0; i < 3; ++i) writer->write({kStampNs + i}, kDataPort, bytes);
  writer->close();

  const std::string ip = tests::ipv4_udp(kDataPort, "payload");
  tests::PcapngText mixed;
  std::uint32_t interfaces = 0;
  for (const int link : {tests::kLinkNull, tests::kLinkEthernet, tests::kLinkRaw, tests::kLinkLoop,
                         tests::kLinkCooked, tests::kLinkIpv4, tests::kLinkCooked2}) {
    const std::string frame = tests::link_frame(link, ip);
    folder.add("frame_" + std::to_string(link), frame);
    folder.add("link_" + std::to_string(link), tests::PcapText(link).packet(kStampNs, frame).bytes());
    mixed.interface(link, interfaces == 0 ? mixed.option(9, "\x09") : std::string());
    mixed.packet(interfaces++, kStampNs / 1000, frame);
  }
  mixed.simple_packet(tests::link_frame(tests::kLinkNull, ip)).block(5, "statistics..");
  folder.add("mixed_pcapng", mixed.bytes());
  const std::string frame = tests::link_frame(tests::kLinkEthernet, ip);
  folder.add("big_endian", tests::PcapText(1, true, false).packet(kStampNs, frame, 1500).bytes());
  tests::PcapngText big(true);
  big.interface(1, big.option(9, "\x94")).packet(0, 1U << 30, frame).section(false).interface(1);
  folder.add("big_endian_pcapng", big.packet(0, 5, frame).bytes());
}

void write_candump_seeds(const SeedFolder& folder) {
  for (const std::string& name : drivers::imu_preset_names()) {
    const auto preset = drivers::imu_preset(name);
    if (!preset) throw std::runtime_error(preset.error().message);
    std::string log = "# a comment\n";
    for (std::int64_t i = 0; i < 3; ++i) {
      const core::ImuSample sample{{kStampNs + i * 10'000'000}, {0.1, 0.2, -0.3}, {0.0, 0.0, 9.81}};
      for (const drivers::CanFrame& frame : drivers::encode_imu_sample(sample, *preset)) {
        log += drivers::format_candump_line(frame, "can0") + "\n";
      }
    }
    folder.add(name, log);
  }
  folder.add("forms",
             "(1700000000.123456) can0 123#0011223344556677\n(1700000000.123456789) vcan1 1234ABCD#R8\n"
             "(1.000000) can0 7FF##3112233 R\n(2.000000) can1 20000080#0000000000000000\nbroken\n");
}

/// A captured CAN frame, in network order.
std::string captured_can(std::uint32_t id, const std::string& data, std::size_t size) {
  const std::string length{static_cast<char>(data.size()), '\0', '\0', '\0'};
  return tests::ByteText(true).u32(id).text(length).text(data).pad(size).bytes();
}

void write_can_capture_seeds(const SeedFolder& folder) {
  const std::string frame = captured_can(0x123, "abcdef", 16);
  const std::string flexible = captured_can(0x98765432U, std::string(48, 'f'), 72);
  folder.add("socketcan",
             tests::PcapText(tests::kLinkCan).packet(kStampNs, frame).packet(kStampNs + 1, flexible).bytes());
  const std::string cooked =
      tests::ByteText(true).u16(0x000C).u16(0).u32(3).u16(280).u16(0).u32(0).u32(0).text(frame).bytes();
  folder.add("cooked", tests::PcapText(tests::kLinkCooked2).packet(kStampNs, cooked).bytes());
  tests::PcapngText mixed;
  mixed.interface(tests::kLinkEthernet).interface(tests::kLinkCan, mixed.option(2, "can0"));
  folder.add("pcapng", mixed.packet(1, kStampNs / 1000, frame).packet(1, kStampNs / 1000, flexible).bytes());
}

/// Input of fuzz_imu: preset, then for each frame message, data and time step.
void write_imu_seeds(const SeedFolder& folder) {
  const std::vector<std::string> names = drivers::imu_preset_names();
  for (std::size_t number = 0; number < names.size(); ++number) {
    const auto preset = drivers::imu_preset(names[number]);
    if (!preset) throw std::runtime_error(preset.error().message);
    std::string input{static_cast<char>(number)};
    for (std::uint8_t i = 0; i < 200; ++i) {
      for (std::size_t m = 0; m < preset->database.messages.size(); ++m) {
        std::string data(preset->database.messages[m].length, '\x40');
        if (!data.empty()) data[0] = static_cast<char>(i);
        if (data.size() > 6) data[6] = static_cast<char>(i % 16);
        input += static_cast<char>(m) + data + static_cast<char>(m == 0 ? 40 : 2);
      }
    }
    folder.add(names[number], input);
  }
}

void write_can_log_seeds(const SeedFolder& folder) {
  folder.add("terminal",
             " (1700000000.123456)  can0  034   [6]  00 00 00 00 09 CF\n (000.010000)  can1  RX - -  "
             "1ABCDEF0   [2]  01 "
             "02   '..'\n (000.009000)  can0  123   [4]  remote request\n  can0  124  [12]  01 02 03 04 05 "
             "06 07 08 09 "
             "0A 0B 0C\n  can0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n");
  folder.add("asc",
             "date Tue Nov 14 10:13:20.5 pm 2023\nbase hex  timestamps relative\n   0.000000 1  123          "
             "   Rx   d "
             "3 01 02 FF\n 0.1 1  1ABCDEF0x       Rx   r 2\n 1.2 1  ErrorFrame\n 1.8 CANFD   1 Rx        123 "
             " name 1 0 "
             "9 12 01 02 03 04 05 06 07 08 09 0A 0B 0C   130000\n");
}

void write_telemetry_seeds(const SeedFolder& folder) {
  drivers::PositionPacket packet;
  packet.timestamp_us = 800'000'000;
  packet.pps = drivers::PpsState::kLocked;
  packet.health.top_board_degc = 40;
  for (const char* sentence : {"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,W*6A\r\n",
                               "$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n", ""}) {
    packet.set_nmea(sentence);
    const auto bytes = drivers::encode_position_packet(packet);
    folder.add("position_" + std::to_string(std::string(sentence).size()), {bytes.begin(), bytes.end()});
  }
  packet.motion.emplace();
  const auto bytes = drivers::encode_position_packet(packet);
  folder.add("motion", {bytes.begin(), bytes.end()});
}

void write_status_seeds(const SeedFolder& folder) {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS3);
  auto writer = drivers::Hdl64eStatusWriter::create(sensor.lasers, {});
  if (!writer) throw std::runtime_error(writer.error().message);
  std::string stream;
  for (std::size_t i = 0; i < 2 * drivers::kHdl64eStatusPackets; ++i) {
    const drivers::Hdl64eStatusByte status = writer->next({});
    stream += {static_cast<char>(status.type), static_cast<char>(status.value)};
  }
  folder.add("stream", stream);
}

template <class Write>
void write_seed_folder(const fs::path& root, const std::string& target, const Write& write) {
  const SeedFolder folder(root, target);
  write(folder);
  folder.write_list();
}

void write_seeds(const fs::path& root, const fs::path& sources) {
  write_seed_folder(root, "packets", write_packet_seeds);
  write_seed_folder(root, "pcap", write_capture_seeds);
  write_seed_folder(root, "candump", [](const SeedFolder& folder) {
    write_candump_seeds(folder);
    write_can_log_seeds(folder);
    write_can_capture_seeds(folder);
  });
  write_seed_folder(root, "imu", write_imu_seeds);
  write_seed_folder(root, "calibration", write_calibration_seeds);
  write_seed_folder(root, "telemetry", write_telemetry_seeds);
  write_seed_folder(root, "status", write_status_seeds);
  const auto write_bags = [&](const char* target, const std::vector<BagSeed>& seeds) {
    write_seed_folder(root, target, [&](const SeedFolder& folder) {
      for (const BagSeed& seed : seeds) folder.add(seed.name, seed.bytes);
    });
  };
  write_bags("rosbag1", rosbag1_seeds());
  write_bags("mcap", mcap_seeds());
  write_bags("db3", db3_seeds());
  write_seed_folder(root, "dbc", [&](const SeedFolder& folder) { folder.add_files(sources / "config/dbc"); });
}

}  // namespace
}  // namespace nilio::fuzz

int main(int argc, char** argv) {
  if (argc != 3) {
    std::fprintf(stderr, "usage: fuzz_seeds FOLDER SOURCES\n");
    return 2;
  }
  try {
    nilio::fuzz::write_seeds(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fuzz_seeds: %s\n", error.what());
    return 1;
  }
  return 0;
}
