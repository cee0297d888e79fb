#include "daemon/input/input.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/network/udp.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "daemon/config/schema.hpp"
#include "daemon/input/bag_input.hpp"
#include "daemon/input/imu_input.hpp"
#include "daemon/input/kitti_sequence.hpp"
#include "daemon/input/sender_selection.hpp"
#include "daemon/input/sensor_identification.hpp"

#include <set>
#include <span>
#include <utility>
#include <variant>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

constexpr std::size_t kReadBatch = 64;

drivers::PcapSourceConfig pcap_config(const LidarConfig& config) {
  drivers::PcapSourceConfig result;
  result.data_port = static_cast<std::uint16_t>(config.port);
  result.position_port = static_cast<std::uint16_t>(config.position_port);
  result.sender_address = config.sender_address;
  return result;
}

/// Sensor identification from the first packets of a LiDAR in a recording.
struct CaptureHead {
  /// Empty if the recording has no packets of this LiDAR; `status` then describes its content.
  std::optional<drivers::VelodyneSensor> sensor;
  core::Time first_stamp;
  /// Position packets carry an HDL-32E's gyros and accelerometers.
  bool has_motion = false;
  std::string status;
};

/// The sender that niliod will select during playback; empty if the recording has no data packets.
std::optional<std::uint32_t> find_sender(drivers::PacketSource& source) {
  SenderSelection selection;
  std::vector<drivers::Packet> packets(kReadBatch);
  for (drivers::SourceRead read = source.read(packets, {}); read.state == drivers::SourceState::kData;
       read = source.read(packets, {})) {
    for (const drivers::Packet& packet : std::span(packets).first(read.count)) {
      if (packet.truncated) continue;
      if (selection.examine(packet) == SenderSelection::Verdict::kSelected) return selection.sender();
    }
  }
  selection.finish();
  return selection.sender();
}

bool has_motion(const drivers::Packet& packet) {
  if (!drivers::is_position_packet(packet)) return false;
  const auto position = drivers::parse_position_packet(std::span(packet.data).first(packet.size));
  return position && position->motion;
}

using OpenPackets = std::function<Result<std::unique_ptr<drivers::PacketSource>>()>;

/// `open` opens the recorded packets, and `name` names them.
Result<CaptureHead> identify_recorded(const OpenPackets& open, const std::string& name,
                                      const LidarConfig& config, const std::string& section, Input& input) {
  Result<std::unique_ptr<drivers::PacketSource>> source = open();
  if (!source) return source.error();
  CaptureHead head;
  const std::optional<std::uint32_t> sender = find_sender(**source);
  if (!sender) {
    head.status = (*source)->status();
    return head;
  }
  source = open();
  if (!source) return source.error();
  SensorIdentification identification(config, section);
  std::vector<drivers::Packet> packets(kReadBatch);
  SensorIdentification::State state = SensorIdentification::State::kUndecided;
  bool is_empty = true;
  while (state == SensorIdentification::State::kUndecided) {
    const drivers::SourceRead read = (*source)->read(packets, core::Duration{});
    if (read.state != drivers::SourceState::kData) break;
    if (std::exchange(is_empty, false)) head.first_stamp = packets.front().stamp;
    for (const drivers::Packet& packet : std::span(packets).first(read.count)) {
      if (packet.sender_address != *sender) continue;
      head.has_motion = head.has_motion || has_motion(packet);
      if (state == SensorIdentification::State::kUndecided) state = identification.add(packet);
    }
  }
  if (state == SensorIdentification::State::kUndecided) state = identification.finish();
  if (state == SensorIdentification::State::kRejected) return Error{name + ": " + identification.problem()};
  const std::string prefix = section == "lidar" ? "" : section + ": ";
  for (const std::string& note : identification.notes()) input.notes.push_back(prefix + note);
  for (const std::string& warning : identification.warnings()) input.warnings.push_back(warning);
  head.sensor = identification.take();
  return head;
}

Result<CaptureHead> identify_in_capture(const std::vector<std::string>& paths, const LidarConfig& config,
                                        const std::string& section, Input& input) {
  const auto open = [&] { return drivers::chain_captures(paths, pcap_config(config)); };
  return identify_recorded(open, paths.front(), config, section, input);
}

std::string describe(const std::vector<std::string>& parts) {
  if (parts.size() == 1) return parts.front();
  return parts.front() + " to " + parts.back() + " (" + std::to_string(parts.size()) + " files)";
}

/// Files with the recording's CAN frames: CAN logs, otherwise the captures; empty if there are none.
std::vector<std::string> find_can_files(const ReplayFiles& files) {
  if (!files.can_logs.empty()) return files.can_logs;
  return !files.captures.empty() && drivers::has_can_frames(files.captures.front())
             ? files.captures
             : std::vector<std::string>{};
}

Result<std::unique_ptr<drivers::FrameSource>> open_can_files(const ReplayFiles& files,
                                                             const std::vector<std::string>& can_files,
                                                             const std::string& interface_name) {
  return files.can_logs.empty() ? drivers::chain_can_captures(can_files, interface_name)
                                : drivers::chain_can_logs(can_files, interface_name);
}

Result<std::monostate> open_recorded_imu(const ReplayFiles& files, const Config& config, bool has_motion,
                                         Input& input) {
  if (!config.imu.enabled) {
    input.notes.push_back(std::string("imu.enabled: false; ") + kNoImu);
    return std::monostate{};
  }
  const std::vector<std::string> can_files =
      config.imu.source == "hdl32e" ? std::vector<std::string>{} : find_can_files(files);
  if (can_files.empty() && has_motion && config.imu.source != "can") {
    use_lidar_imu(input);
    return std::monostate{};
  }
  if (can_files.empty()) {
    const char* const missing = config.imu.source == "hdl32e"
                                    ? "imu.source: hdl32e, but no position packet has an HDL-32E's motion; "
                                    : "no CAN log and no CAN frames in the recording; ";
    input.warnings.emplace_back(std::string(missing) + kNoImu);
    return std::monostate{};
  }
  // One source is read for the identification, another for the run.
  auto head = open_can_files(files, can_files, config.imu.interface_name);
  if (!head) return head.error();
  const Result<std::monostate> found = find_recorded_imu(config.imu, **head, describe(can_files), input);
  if (!found && has_motion && config.imu.source == "auto" && is_imu_auto(config.imu)) {
    input.warnings.push_back(found.error().message);
    use_lidar_imu(input);
    return std::monostate{};
  }
  if (!found) return found.error();
  Result<std::unique_ptr<drivers::FrameSource>> frames =
      open_can_files(files, can_files, config.imu.interface_name);
  if (!frames) return frames.error();
  input.frames = std::move(frames).value();
  warn_of_missing_parts(can_files, input.warnings);
  return std::monostate{};
}

/// Configured LiDAR and the name of its section.
struct ConfiguredLidar {
  std::string section;
  const LidarConfig* config;
};

std::vector<ConfiguredLidar> lidars_in_use(const Config& config) {
  std::vector<ConfiguredLidar> lidars{{"lidar", &config.lidar}};
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i) {
    if (config.more_lidars[i].enabled) lidars.push_back({extra_lidar_section(i), &config.more_lidars[i]});
  }
  return lidars;
}

/// Fails if two LiDARs would receive the same packets.
Result<std::monostate> check_told_apart(const Config& config) {
  const std::vector<ConfiguredLidar> lidars = lidars_in_use(config);
  for (std::size_t i = 0; i < lidars.size(); ++i) {
    for (std::size_t k = 0; k < i; ++k) {
      const LidarConfig& a = *lidars[k].config;
      const LidarConfig& b = *lidars[i].config;
      const bool apart =
          a.port != b.port ||
          (!a.sender_address.empty() && !b.sender_address.empty() && a.sender_address != b.sender_address) ||
          a.multicast_group != b.multicast_group;
      if (!apart) {
        return Error{lidars[k].section + " and " + lidars[i].section + " receive the same packets (port " +
                     std::to_string(a.port) +
                     ") - configure different ports, or in a recording a sender_address each"};
      }
    }
  }
  return std::monostate{};
}

Result<std::monostate> open_more_captures(const ReplayFiles& files, const Config& config, Input& input) {
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i) {
    const ExtraLidarConfig& lidar = config.more_lidars[i];
    if (!lidar.enabled) continue;
    const std::string section = extra_lidar_section(i);
    Result<CaptureHead> head = identify_in_capture(files.captures, lidar, section, input);
    if (!head) return head.error();
    if (!head->sensor) {
      input.warnings.push_back(
          section + ": no packets in the recording; poses are computed without it: " + head->status);
      continue;
    }
    Result<std::unique_ptr<drivers::PacketSource>> packets =
        drivers::chain_captures(files.captures, pcap_config(lidar));
    if (!packets) return packets.error();
    input.more_lidars.push_back({section, lidar, std::move(packets).value(), std::move(head->sensor)});
  }
  return std::monostate{};
}

Result<std::unique_ptr<drivers::PacketSource>> open_socket(const LidarConfig& config) {
  drivers::UdpSourceConfig udp;
  udp.bind_address = config.bind_address;
  udp.port = static_cast<std::uint16_t>(config.port);
  udp.position_port = static_cast<std::uint16_t>(config.position_port);
  udp.sender_address = config.sender_address;
  udp.multicast_group = config.multicast_group;
  udp.multicast_interface = config.multicast_interface;
  udp.receive_buffer_bytes = config.receive_buffer_bytes;
  return drivers::open_udp(udp);
}

Result<std::monostate> open_more_sockets(const Config& config, Input& input) {
  std::set<int> position_ports{config.lidar.position_port};
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i) {
    ExtraLidarConfig lidar = config.more_lidars[i];
    if (!lidar.enabled) continue;
    const std::string section = extra_lidar_section(i);
    if (lidar.position_port != 0 && !position_ports.insert(lidar.position_port).second) {
      input.warnings.push_back(section + ": position port " + std::to_string(lidar.position_port) +
                               " is used by another LiDAR already; the position packets of this one are not "
                               "received - configure a "
                               "different port, or set " +
                               section + ".position_port to 0");
      lidar.position_port = 0;
    }
    Result<std::unique_ptr<drivers::PacketSource>> packets = open_socket(lidar);
    if (!packets) return Error{section + ": " + packets.error().message};
    input.notes.push_back(section + ": " + (*packets)->status());
    input.more_lidars.push_back({section, lidar, std::move(packets).value(), std::nullopt});
  }
  return std::monostate{};
}

}  // namespace

void apply_extrinsics(const Input& input, Config& config) {
  if (input.lidar_extrinsic) config.lidar.extrinsic = *input.lidar_extrinsic;
  if (input.imu_extrinsic) config.imu.extrinsic = *input.imu_extrinsic;
}

Result<std::monostate> open_recorded_packets(const OpenPackets& open, const std::string& name,
                                             const Config& config, Input& input) {
  Result<CaptureHead> head = identify_recorded(open, name, config.lidar, "lidar", input);
  if (!head) return head.error();
  if (!head->sensor) return Error{head->status};
  Result<std::unique_ptr<drivers::PacketSource>> packets = open();
  if (!packets) return packets.error();
  input.packets = std::move(packets).value();
  input.sensor = std::move(head->sensor);
  input.first_stamp = head->first_stamp;
  return std::monostate{};
}

void apply_recording_defaults(const ReplayFiles& files, Config& config) {
  // The KITTI scanner reads 0.205 degrees low (Deschaud 2018, IMLS-SLAM); a property of the data set.
  if (!files.kitti_sequence.empty()) config.lidar.elevation_correction_deg = 0.205;
}

Result<Config> replay_config(const ReplayFiles& files, const std::string& config_file) {
  Config config;
  apply_recording_defaults(files, config);
  for (const std::string& file : {files.configuration, config_file}) {
    if (file.empty()) continue;
    if (auto applied = apply_file(config, file); !applied) return applied.error();
  }
  return config;
}

Result<Input> open_replay(const ReplayFiles& files, const Config& config) {
  Input input;
  if (!files.kitti_sequence.empty()) {
    Result<KittiSequence> sequence = open_kitti_sequence(files.kitti_sequence);
    if (!sequence) return sequence.error();
    input.notes.push_back("KITTI sequence " + files.kitti_sequence + ": " + std::to_string(sequence->scans) +
                          " scans, already motion-compensated");
    input.warnings = std::move(sequence->warnings);
    input.scans = std::move(sequence->feed);
    input.T_camera_lidar = sequence->T_camera_lidar;
    return input;
  }
  if (!files.bags.empty()) {
    // A CAN log beside the bag holds the IMU.
    const bool has_log = !files.can_logs.empty() && config.recording.imu_topic.empty();
    Result<Input> bag = open_bag_replay(files.bags, config, has_log ? ImuPlace::kElsewhere : ImuPlace::kBag);
    if (!bag || !has_log) return bag;
    if (auto imu = open_recorded_imu(files, config, false, *bag); !imu) return imu.error();
    return bag;
  }
  if (auto checked = check_told_apart(config); !checked) return checked.error();
  Result<CaptureHead> head = identify_in_capture(files.captures, config.lidar, "lidar", input);
  if (!head) return head.error();
  if (!head->sensor) return Error{head->status};
  Result<std::unique_ptr<drivers::PacketSource>> packets =
      drivers::chain_captures(files.captures, pcap_config(config.lidar));
  if (!packets) return packets.error();
  input.notes.push_back("packets from " + describe(files.captures));
  warn_of_missing_parts(files.captures, input.warnings);
  input.packets = std::move(packets).value();
  input.sensor = std::move(head->sensor);
  input.first_stamp = head->first_stamp;
  if (auto more = open_more_captures(files, config, input); !more) return more.error();
  Result<std::monostate> imu = open_recorded_imu(files, config, head->has_motion, input);
  if (!imu) return imu.error();
  return input;
}

Result<std::monostate> check_live(const Config& config) {
  if (auto checked = check_told_apart(config); !checked) return checked;
  for (const ConfiguredLidar& lidar : lidars_in_use(config)) {
    if (auto checked = check_lidar(*lidar.config, lidar.section); !checked) return checked;
  }
  if (!config.imu.enabled || config.imu.dbc.empty()) return std::monostate{};
  std::vector<std::string> warnings;
  if (auto decoder = make_imu_decoder(config.imu, warnings); !decoder) return decoder.error();
  return std::monostate{};
}

Result<Input> open_live(const Config& config) {
  Input input;
  if (auto checked = check_live(config); !checked) return checked.error();
  Result<std::unique_ptr<drivers::PacketSource>> packets = open_socket(config.lidar);
  if (!packets) return packets.error();
  input.packets = std::move(packets).value();
  input.notes.push_back(input.packets->status());
  if (auto more = open_more_sockets(config, input); !more) return more.error();
  if (auto opened = open_live_imu(config, input); !opened) return opened.error();
  return input;
}

}  // namespace nilio::daemon
