#include "nilio/daemon/input.hpp"

#include "nilio/daemon/kitti_sequence.hpp"
#include "nilio/drivers/candump.hpp"
#include "nilio/drivers/chained_source.hpp"
#include "nilio/drivers/pcap.hpp"
#include "nilio/drivers/udp.hpp"
#include "nilio/drivers/velodyne_detect.hpp"

#include "imu_input.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <optional>
#include <set>
#include <string_view>
#include <utility>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr double kRadiansPerDegree = std::numbers::pi / 180.0;
// Packets looked at to tell the model; also enough to see a block of each flag.
constexpr std::size_t kDetectionPackets = 64;

core::SE3 to_transform(const ExtrinsicConfig& extrinsic) {
  const auto& t = extrinsic.translation;
  const auto& rpy = extrinsic.rotation_rpy_deg;
  const Eigen::Quaterniond rotation = Eigen::AngleAxisd(rpy[2] * kRadiansPerDegree, core::Vector3::UnitZ()) *
                                      Eigen::AngleAxisd(rpy[1] * kRadiansPerDegree, core::Vector3::UnitY()) *
                                      Eigen::AngleAxisd(rpy[0] * kRadiansPerDegree, core::Vector3::UnitX());
  return {rotation.normalized(), core::Vector3(t[0], t[1], t[2])};
}

/// Puts `path` into the slot for its kind; an error when the slot is taken.
Result<std::monostate> put(std::string& slot, const std::string& path, const std::string& kind) {
  if (!slot.empty())
    return Error{path + ": a second " + kind + " beside " + slot + ": name the one to replay"};
  slot = path;
  return std::monostate{};
}

/// The number of a file that `nilio record` wrote, such as 12 of lidar_0012.pcap.
std::optional<std::uint64_t> part_number(const fs::path& path) {
  const std::string name = path.stem().string();
  const std::string extension = path.extension().string();
  const std::string_view prefix = extension == ".pcap" ? "lidar_" : extension == ".log" ? "can_" : "";
  if (prefix.empty() || !name.starts_with(prefix)) return std::nullopt;
  const char* const end = name.data() + name.size();
  std::uint64_t number = 0;
  const auto parsed = std::from_chars(name.data() + prefix.size(), end, number);
  if (parsed.ec != std::errc{} || parsed.ptr != end) return std::nullopt;
  return number;
}

/// Adds `path` to the parts of one recording; an error when it is no part of the one that is there.
Result<std::monostate> put_part(std::vector<std::string>& parts, const fs::path& path,
                                const std::string& kind) {
  if (!parts.empty()) {
    const fs::path first = parts.front();
    const auto number = part_number(path);
    const bool together = number && path.parent_path() == first.parent_path() &&
                          std::all_of(parts.begin(), parts.end(), [&](const std::string& part) {
                            const auto other = part_number(part);
                            return other && other != number;
                          });
    if (!together)
      return Error{path.string() + ": a second " + kind + " beside " + first.string() +
                   ": name the one to replay"};
  }
  parts.push_back(path.string());
  std::stable_sort(parts.begin(), parts.end(), [](const std::string& a, const std::string& b) {
    return part_number(a) < part_number(b);
  });
  return std::monostate{};
}

/// A part that is missing between others was lost, not left out on purpose: --keep takes the oldest.
void warn_of_missing_parts(const std::vector<std::string>& parts, std::vector<std::string>& warnings) {
  for (std::size_t i = 1; i < parts.size(); ++i) {
    const std::uint64_t before = *part_number(parts[i - 1]);
    const std::uint64_t next = *part_number(parts[i]);
    if (next > before + 1)
      warnings.push_back(parts[i - 1] + ": " + std::to_string(next - before - 1) +
                         " parts of the recording are missing after it");
  }
}

/// True when one of the file's first lines is a CAN frame: other programs write *.log files, too.
bool looks_like_can_log(const fs::path& path) {
  constexpr int kLinesToLookAt = 20;
  std::ifstream file(path);
  std::string line;
  for (int i = 0; i < kLinesToLookAt && std::getline(file, line); ++i) {
    if (drivers::parse_candump_line(line)) return true;
  }
  return false;
}

Result<std::monostate> sort_file(const fs::path& path, ReplayFiles& files, bool named_by_user) {
  static const std::set<std::string> kCaptures = {".pcap", ".pcapng", ".cap"};
  static const std::set<std::string> kCanLogs = {".log", ".candump"};
  const std::string extension = path.extension().string();
  if (kCaptures.contains(extension)) return put_part(files.captures, path, "capture");
  if (kCanLogs.contains(extension) && (named_by_user || part_number(path) || looks_like_can_log(path))) {
    return put_part(files.can_logs, path, "CAN log");
  }
  if (path.filename() == "nilio.yaml") return put(files.configuration, path.string(), "configuration");
  if (!named_by_user) return std::monostate{};
  return Error{path.string() +
               ": not a recording: expected a capture (.pcap, .pcapng), a CAN log (.log, .candump) or a "
               "folder of them"};
}

Result<std::monostate> sort_path(const std::string& path, ReplayFiles& files) {
  std::error_code error;
  if (!fs::exists(path, error)) return Error{path + ": does not exist"};
  if (!fs::is_directory(path, error)) return sort_file(path, files, true);
  if (is_kitti_sequence(path)) return put(files.kitti_sequence, path, "KITTI sequence");
  std::set<fs::path> entries;
  for (fs::directory_iterator entry(path, error), end; !error && entry != end; entry.increment(error))
    entries.insert(entry->path());
  if (error) return Error{path + ": cannot be read (" + error.message() + "); check its permissions"};
  for (const fs::path& entry : entries) {
    Result<std::monostate> sorted = sort_file(entry, files, false);
    if (!sorted) return sorted;
  }
  return std::monostate{};
}

drivers::PcapSourceConfig pcap_config(const Config& config) {
  drivers::PcapSourceConfig result;
  result.data_port = static_cast<std::uint16_t>(config.lidar.port);
  result.position_port = static_cast<std::uint16_t>(config.lidar.position_port);
  result.sender_address = config.lidar.sender_address;
  return result;
}

/// Reads the capture's first packets: what they say of the sensor, and the first stamp.
struct CaptureHead {
  drivers::VelodyneDetection detection;
  core::Time first_stamp;
};

Result<CaptureHead> look_at_capture(const std::vector<std::string>& paths, const Config& config) {
  Result<std::unique_ptr<drivers::PacketSource>> source = drivers::chain_captures(paths, pcap_config(config));
  if (!source) return source.error();
  std::vector<drivers::Packet> packets(kDetectionPackets);
  std::size_t count = 0;
  while (count < packets.size()) {
    const drivers::SourceRead read = (*source)->read(std::span(packets).subspan(count), core::Duration{});
    if (read.state != drivers::SourceState::kData) break;
    count += read.count;
  }
  if (count == 0) return Error{(*source)->status()};
  packets.resize(count);
  return CaptureHead{drivers::detect_velodyne(packets), packets.front().stamp};
}

std::string candidate_names(const drivers::VelodyneDetection& detection) {
  std::string names;
  for (const drivers::VelodyneModel model : detection.candidates)
    names += (names.empty() ? "" : " or ") + std::string(drivers::velodyne_model_name(model));
  return names;
}

/// `detection` is null when there are no packets to look at.
Result<drivers::VelodyneModel> choose_model(const Config& config,
                                            const drivers::VelodyneDetection* detection) {
  if (config.lidar.model == "auto") {
    if (detection != nullptr && detection->model) return *detection->model;
    const std::string seen = detection == nullptr ? std::string() : " (" + detection->evidence + ")";
    if (detection != nullptr && !detection->candidates.empty())
      return Error{"the sensor is a " + candidate_names(*detection) + seen + ": say which with lidar.model"};
    return Error{"the packets do not tell the sensor model" + seen + ": set lidar.model"};
  }
  const std::optional<drivers::VelodyneModel> wanted = drivers::parse_velodyne_model(config.lidar.model);
  if (!wanted) return Error{"lidar.model '" + config.lidar.model + "' is no known model"};
  if (detection != nullptr && !detection->candidates.empty() && !detection->agrees_with(*wanted)) {
    return Error{"lidar.model is " + config.lidar.model + ", but the packets are of a " +
                 candidate_names(*detection) + " (" + detection->evidence +
                 "): correct it, or set lidar.model to auto"};
  }
  return *wanted;
}

Result<drivers::VelodyneSensor> make_sensor(const Config& config, const drivers::VelodyneDetection* detection,
                                            std::vector<std::string>& notes) {
  const Result<drivers::VelodyneModel> model = choose_model(config, detection);
  if (!model) return model.error();
  drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(*model);
  notes.push_back("LiDAR " + sensor.name + (config.lidar.model == "auto" ? " (from the packets)" : ""));
  if (config.lidar.azimuth_interpolation != "auto")
    drivers::set_azimuth_interpolation(sensor, config.lidar.azimuth_interpolation == "on");
  if (config.lidar.calibration.empty()) return sensor;
  return drivers::with_calibration_file(std::move(sensor), config.lidar.calibration);
}

std::string describe(const std::vector<std::string>& parts) {
  if (parts.size() == 1) return parts.front();
  return parts.front() + " to " + parts.back() + " (" + std::to_string(parts.size()) + " files)";
}

Result<std::monostate> open_can_log(const ReplayFiles& files, const Config& config, Input& input) {
  if (!config.imu.enabled) {
    input.notes.push_back(std::string("imu.enabled is false; ") + kNoImu);
    return std::monostate{};
  }
  if (files.can_logs.empty()) {
    input.warnings.emplace_back(std::string("no CAN log beside the recording: ") + kNoImu);
    return std::monostate{};
  }
  Result<drivers::ImuDecoder> decoder = make_imu_decoder(config.imu);
  if (!decoder) return decoder.error();
  Result<std::unique_ptr<drivers::FrameSource>> frames =
      drivers::chain_can_logs(files.can_logs, config.imu.interface_name);
  if (!frames) return frames.error();
  input.frames = std::move(frames).value();
  input.imu_decoder.emplace(std::move(decoder).value());
  input.notes.push_back("IMU " + (config.imu.dbc.empty() ? config.imu.preset : config.imu.dbc) + " from " +
                        describe(files.can_logs));
  warn_of_missing_parts(files.can_logs, input.warnings);
  return std::monostate{};
}

}  // namespace

Result<ReplayFiles> sort_replay_files(const std::vector<std::string>& paths) {
  ReplayFiles files;
  for (const std::string& path : paths) {
    Result<std::monostate> sorted = sort_path(path, files);
    if (!sorted) return sorted.error();
  }
  if (!files.captures.empty() && !files.kitti_sequence.empty()) {
    return Error{files.captures.front() + ": beside the KITTI sequence " + files.kitti_sequence +
                 ": replay one of them"};
  }
  return files;
}

Result<ReplayFiles> find_replay_files(const std::vector<std::string>& paths) {
  Result<ReplayFiles> files = sort_replay_files(paths);
  if (files && files->captures.empty() && files->kitti_sequence.empty()) {
    return Error{
        paths.front() +
        ": nothing to replay: expected a capture (.pcap, .pcapng) or a KITTI sequence (velodyne/*.bin)"};
  }
  return files;
}

void apply_recording_defaults(const ReplayFiles& files, Config& config) {
  // KITTI's scanner reads 0.205 degrees low (Deschaud 2018, IMLS-SLAM): a property of the data set.
  if (!files.kitti_sequence.empty()) config.lidar.elevation_correction_deg = 0.205;
}

Result<Input> open_replay(const ReplayFiles& files, const Config& config) {
  Input input;
  if (!files.kitti_sequence.empty()) {
    Result<KittiSequence> sequence = open_kitti_sequence(files.kitti_sequence);
    if (!sequence) return sequence.error();
    input.notes.push_back("KITTI sequence " + files.kitti_sequence + ": " + std::to_string(sequence->scans) +
                          " scans, already motion-compensated");
    input.scans = std::move(sequence->feed);
    input.T_camera_lidar = sequence->T_camera_lidar;
    return input;
  }
  Result<CaptureHead> head = look_at_capture(files.captures, config);
  if (!head) return head.error();
  Result<drivers::VelodyneSensor> sensor = make_sensor(config, &head->detection, input.notes);
  if (!sensor) return Error{files.captures.front() + ": " + sensor.error().message};
  Result<std::unique_ptr<drivers::PacketSource>> packets =
      drivers::chain_captures(files.captures, pcap_config(config));
  if (!packets) return packets.error();
  input.notes.push_back("packets from " + describe(files.captures));
  warn_of_missing_parts(files.captures, input.warnings);
  input.packets = std::move(packets).value();
  input.sensor = std::move(sensor).value();
  input.first_stamp = head->first_stamp;
  Result<std::monostate> can = open_can_log(files, config, input);
  if (!can) return can.error();
  return input;
}

Result<Input> open_live(const Config& config) {
  Input input;
  input.live = true;
  if (config.lidar.model == "auto") {
    return Error{
        "lidar.model is auto, which needs a recording to look at: set it to the sensor's model for live use"};
  }
  Result<drivers::VelodyneSensor> sensor = make_sensor(config, nullptr, input.notes);
  if (!sensor) return sensor.error();
  drivers::UdpSourceConfig udp;
  udp.bind_address = config.lidar.bind_address;
  udp.port = static_cast<std::uint16_t>(config.lidar.port);
  udp.position_port = static_cast<std::uint16_t>(config.lidar.position_port);
  udp.sender_address = config.lidar.sender_address;
  udp.multicast_group = config.lidar.multicast_group;
  udp.multicast_interface = config.lidar.multicast_interface;
  udp.receive_buffer_bytes = config.lidar.receive_buffer_bytes;
  Result<std::unique_ptr<drivers::PacketSource>> packets = drivers::open_udp(udp);
  if (!packets) return packets.error();
  input.packets = std::move(packets).value();
  input.sensor = std::move(sensor).value();
  input.notes.push_back(input.packets->status());
  if (auto opened = open_live_imu(config.imu, input); !opened) return opened.error();
  return input;
}

namespace {

std::optional<drivers::ReturnMode> return_mode(const std::string& name) {
  if (name == "single") return drivers::ReturnMode::kSingle;
  if (name == "dual") return drivers::ReturnMode::kDual;
  if (name == "dual_confidence") return drivers::ReturnMode::kDualConfidence;
  return std::nullopt;
}

}  // namespace

core::OdometryConfig odometry_config(const Config& config) {
  core::OdometryConfig result;
  result.T_base_lidar = to_transform(config.lidar.extrinsic);
  result.T_base_imu = to_transform(config.imu.extrinsic);
  result.threads = config.odometry.threads;
  result.elevation_correction_rad =
      static_cast<float>(config.lidar.elevation_correction_deg * kRadiansPerDegree);
  result.min_range_m = static_cast<float>(config.lidar.min_range_m);
  result.max_range_m = static_cast<float>(config.lidar.max_range_m);
  result.filter_voxel_m = static_cast<float>(config.odometry.filter_voxel_m);
  result.registration_points = static_cast<std::size_t>(config.odometry.registration_points);
  result.plane_voxel_m = config.odometry.plane_voxel_m;
  result.coarse_voxel_m = config.odometry.coarse_voxel_m;
  result.map_radius_m = config.odometry.map_radius_m;
  result.map_capacity = static_cast<std::size_t>(config.odometry.map_capacity);
  result.coarse =
      config.odometry.coarse == "always" ? core::CoarsePolicy::kAlways : core::CoarsePolicy::kAuto;
  result.max_passes = config.odometry.max_passes;
  result.max_fine_iterations = config.odometry.max_fine_iterations;
  result.max_coarse_iterations = config.odometry.max_coarse_iterations;
  result.max_imu_gap = core::Duration::from_milliseconds(config.odometry.max_imu_gap_ms);
  return result;
}

drivers::ScanAssemblerConfig assembler_config(const Config& config) {
  drivers::ScanAssemblerConfig result;
  result.time_source = config.lidar.time_source == "sensor" ? drivers::TimeSource::kSensor
                       : config.lidar.time_source == "host" ? drivers::TimeSource::kHost
                                                            : drivers::TimeSource::kAuto;
  result.cut_azimuth_deg = config.lidar.cut_azimuth_deg;
  result.min_range_m = config.lidar.min_range_m;
  result.max_range_m = config.lidar.max_range_m;
  result.min_coverage = config.lidar.min_coverage;
  result.stamp_offset_ns = std::llround(config.lidar.stamp_offset_us * 1e3);
  result.return_mode = return_mode(config.lidar.return_mode);
  result.returns = config.lidar.returns == "strongest" ? drivers::ReturnChoice::kStrongest
                   : config.lidar.returns == "last"    ? drivers::ReturnChoice::kLast
                                                       : drivers::ReturnChoice::kAll;
  return result;
}

}  // namespace nilio::daemon
