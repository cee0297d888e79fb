#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/detect.hpp"

#include "daemon/config/config.hpp"
#include "daemon/input/input.hpp"
#include "tools/common/files.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/mangle/mangle.hpp"
#include "tools/mangle/revolution.hpp"

#include <algorithm>
#include <fstream>
#include <memory>
#include <system_error>

namespace nilio::tools::mangle {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using drivers::Packet;

constexpr std::size_t kBatch = 256;
// Packets that identify the sensor and its return mode.
constexpr std::size_t kSample = 512;
// Larger files beside a recording are data of other sensors.
constexpr std::uintmax_t kMaxCopiedBytes = 64U << 20U;

/// An opened recording.
struct Recording {
  daemon::ReplayFiles files;
  daemon::Config config;
};

Result<Recording> open_recording(const Options& options) {
  Recording recording;
  auto files = daemon::find_replay_files({options.input});
  if (!files) return files.error();
  recording.files = std::move(files).value();
  auto config = daemon::replay_config(recording.files, "");
  if (!config) return config.error();
  recording.config = std::move(config).value();
  const auto& more = recording.config.more_lidars;
  if (std::any_of(more.begin(), more.end(), [](const auto& lidar) { return lidar.enabled; }))
    return Error{options.input +
                 ": has several LiDARs, and only one can be mangled - set lidar2.enabled and the like to "
                 "false in its nilio.yaml"};
  return recording;
}

Result<std::unique_ptr<drivers::PacketSource>> open_packets(const Recording& recording) {
  drivers::PcapSourceConfig config;
  config.data_port = static_cast<std::uint16_t>(recording.config.lidar.port);
  config.position_port = static_cast<std::uint16_t>(recording.config.lidar.position_port);
  config.sender_address = recording.config.lidar.sender_address;
  return drivers::chain_captures(recording.files.captures, config);
}

/// Sensor and layout of its packets, for faults of the returns.
Result<RevolutionEditor> make_editor(const Recording& recording, const Faults& faults) {
  daemon::Config config = recording.config;
  config.imu.enabled = false;
  auto input = daemon::open_replay(recording.files, config);
  if (!input) return input.error();
  const drivers::VelodyneSensor& sensor = *input->sensor;
  if (faults.rings >= sensor.lasers.size())
    return Error{"--rings " + std::to_string(faults.rings) + ": the sensor has " +
                 std::to_string(sensor.lasers.size()) + " - give fewer"};
  std::vector<Packet> sample(kSample);
  sample.resize(input->packets->read(sample, core::Duration{}).count);
  const drivers::PacketLayout* const layout = sensor.layout(drivers::detect_velodyne(sample).mode);
  return RevolutionEditor(sensor, layout != nullptr ? *layout : sensor.single(), faults);
}

/// Writes packets to a capture.
class CaptureWriter {
 public:
  explicit CaptureWriter(const fs::path& path) : file_(path, std::ios::binary) {
    drivers::append_pcap_header(bytes_);
  }
  void write(const std::vector<Packet>& packets) {
    for (const Packet& packet : packets) drivers::append_pcap_record(bytes_, packet);
    file_.write(reinterpret_cast<const char*>(bytes_.data()), static_cast<std::streamsize>(bytes_.size()));
    bytes_.clear();
  }
  bool finish() { return static_cast<bool>(file_.flush()); }

 private:
  std::ofstream file_;
  std::vector<std::uint8_t> bytes_;
};

/// Moves packets from the recording through the revolutions and the faults of the stream into the capture.
class PacketCopy {
 public:
  PacketCopy(const Faults& faults, core::Time begin, RevolutionEditor* editor, CaptureWriter& writer)
      : faults_(faults, begin), revolutions_(faults.drop_scans, editor), writer_(writer) {}

  void add(const Packet& packet) {
    revolutions_.add(packet, ready_);
    pass_on();
  }
  void finish() {
    revolutions_.finish(ready_);
    pass_on();
    faults_.finish(arriving_);
    writer_.write(arriving_);
  }
  void count(Summary& summary) const {
    summary.packets = faults_.counts();
    summary.packets.packets = revolutions_.packets();
    summary.scans = revolutions_.revolutions();
    summary.scans_dropped = revolutions_.dropped();
  }
  [[nodiscard]] const PacketFaults& faults() const { return faults_; }

 private:
  void pass_on() {
    for (const Packet& packet : ready_) faults_.add(packet, arriving_);
    ready_.clear();
    if (arriving_.size() < kBatch) return;
    writer_.write(arriving_);
    arriving_.clear();
  }

  PacketFaults faults_;
  Revolutions revolutions_;
  CaptureWriter& writer_;
  std::vector<Packet> ready_;
  std::vector<Packet> arriving_;
};

Result<std::monostate> check_gaps(const Faults& faults, const PacketFaults& applied) {
  for (std::size_t i = 0; i < faults.gaps.size(); ++i) {
    if (applied.lost_in_gap()[i] > 0) continue;
    return Error{"--gap " + std::to_string(faults.gaps[i].amount_s) + "@" +
                 std::to_string(faults.gaps[i].at_s) +
                 ": no packet is in it - give a time within the recording"};
  }
  return std::monostate{};
}

/// Returns the receive time of the first packet.
Result<core::Time> write_capture(const Recording& recording, const Options& options, Summary& summary) {
  std::optional<RevolutionEditor> editor;
  if (options.faults.changes_returns()) {
    auto made = make_editor(recording, options.faults);
    if (!made) return made.error();
    editor.emplace(std::move(made).value());
  }
  auto source = open_packets(recording);
  if (!source) return source.error();
  const UnfinishedFile unfinished(fs::path(options.output) / "lidar.pcap");
  CaptureWriter writer(unfinished.path());
  std::optional<PacketCopy> copy;
  core::Time begin;
  std::vector<Packet> slots(kBatch);
  for (drivers::SourceRead read = (*source)->read(slots, {}); read.state == drivers::SourceState::kData;
       read = (*source)->read(slots, {})) {
    if (!copy) copy.emplace(options.faults, begin = slots.front().stamp, editor ? &*editor : nullptr, writer);
    for (std::size_t i = 0; i < read.count; ++i) copy->add(slots[i]);
  }
  if (!copy) return Error{(*source)->status()};
  copy->finish();
  copy->count(summary);
  if (editor) summary.returns = editor->counts();
  if (auto checked = check_gaps(options.faults, copy->faults()); !checked) return checked.error();
  if (!writer.finish()) return cannot_write(unfinished.path());
  if (auto finished = unfinished.finish(); !finished) return finished.error();
  return begin;
}

Result<std::monostate> write_frames(drivers::FrameSource& source, const std::string& interface,
                                    const Faults& faults, core::Time begin, const fs::path& path) {
  std::ofstream file(path);
  std::vector<drivers::CanFrame> slots(kBatch);
  for (drivers::SourceRead read = source.read(slots, {}); read.state == drivers::SourceState::kData;
       read = source.read(slots, {})) {
    for (std::size_t i = 0; i < read.count; ++i) {
      slots[i].stamp = slots[i].stamp + clock_error(faults, begin, slots[i].stamp);
      file << drivers::format_candump_line(slots[i], interface) << '\n';
    }
  }
  if (file.flush()) return std::monostate{};
  return cannot_write(path);
}

/// The frames of the IMU's interface, from the logs or from captures of both kinds of traffic.
Result<std::monostate> write_can_log(const Recording& recording, const Options& options, core::Time begin) {
  const std::string& interface = recording.config.imu.interface_name;
  std::vector<std::string> captures;
  for (const std::string& path : recording.files.captures) {
    if (drivers::has_can_frames(path)) captures.push_back(path);
  }
  if (recording.files.can_logs.empty() && captures.empty()) return std::monostate{};
  auto source = recording.files.can_logs.empty()
                    ? drivers::chain_can_captures(captures, interface)
                    : drivers::chain_can_logs(recording.files.can_logs, interface);
  if (!source) return source.error();
  return write_frames(**source, interface.empty() ? "can0" : interface, options.faults, begin,
                      fs::path(options.output) / "imu.candump.log");
}

/// Truth, configuration and calibration: the files that were not written anew.
Result<std::monostate> copy_others(const Recording& recording, const Options& options) {
  if (!fs::is_directory(options.input)) return std::monostate{};
  std::vector<std::string> written = recording.files.captures;
  written.insert(written.end(), recording.files.can_logs.begin(), recording.files.can_logs.end());
  for (const auto& entry : fs::directory_iterator(options.input)) {
    const bool is_written = std::any_of(written.begin(), written.end(), [&](const std::string& path) {
      return fs::path(path).filename() == entry.path().filename();
    });
    const bool is_summary = entry.path().filename() == "mangle.json";
    if (is_written || is_summary || !entry.is_regular_file() || entry.file_size() > kMaxCopiedBytes) continue;
    std::error_code error;
    fs::copy_file(entry.path(), fs::path(options.output) / entry.path().filename(), error);
    if (error) return Error{entry.path().string() + ": cannot be copied (" + error.message() + ")"};
  }
  return std::monostate{};
}

/// Stamps of poses follow a clock that is set forward, and continue when it is set back: so do the truth's.
Result<std::monostate> step_truth(const Faults& faults, core::Time begin, const fs::path& path) {
  Faults forward;
  for (const TimedFault& step : faults.clock_steps) {
    if (step.amount_s > 0.0) forward.clock_steps.push_back(step);
  }
  std::error_code ignored;
  if (forward.clock_steps.empty() || !fs::exists(path, ignored)) return std::monostate{};
  auto truth = read_trajectory(path.string());
  if (!truth) return truth.error();
  for (core::Time& stamp : truth->stamps) stamp = stamp + clock_error(forward, begin, stamp);
  const auto written = write_trajectory(*truth, path.string());
  if (!written) return written.error();
  return std::monostate{};
}

}  // namespace

Result<Summary> mangle_packets(const Options& options) {
  if (options.faults.reverse)
    return Error{"--reverse: the packets of a turning sensor cannot be reversed - it is for KITTI sequences"};
  const auto recording = open_recording(options);
  if (!recording) return recording.error();
  Summary summary;
  const auto begin = write_capture(*recording, options, summary);
  if (!begin) return begin.error();
  if (auto written = write_can_log(*recording, options, *begin); !written) return written.error();
  if (auto copied = copy_others(*recording, options); !copied) return copied.error();
  const fs::path truth = fs::path(options.output) / "truth.tum";
  if (auto stepped = step_truth(options.faults, *begin, truth); !stepped) return stepped.error();
  return summary;
}

}  // namespace nilio::tools::mangle
