#include "tools/inspect/sensor.hpp"

#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/common/text.hpp"

#include <algorithm>
#include <cmath>
#include <span>
#include <utility>

namespace nilio::tools::inspect {

namespace {

/// As in niliod.
constexpr std::size_t kDetectionPackets = 64;
/// Sensors rotate at 300 to 1200 rpm.
constexpr double kSlowestRevolutionS = 0.2;
constexpr double kCompleteShare = 0.8;
constexpr double kFullCircleDeg = 360.0;
constexpr double kLargestRangeM = 300.0;
constexpr std::size_t kTimestampOffset = 1200;
constexpr std::size_t kModeOffset = 1204;
constexpr std::size_t kProductOffset = 1205;
constexpr std::size_t kBlockSize = 100;

bool is_hdl64e(drivers::VelodyneModel model) {
  return drivers::make_velodyne_sensor(model).product_byte == 0;
}

unsigned load_le16(const drivers::Packet& packet, std::size_t at) {
  return packet.data[at] | static_cast<unsigned>(packet.data[at + 1]) << 8;
}

std::uint32_t timestamp_of(const drivers::Packet& packet) {
  return load_le16(packet, kTimestampOffset) | load_le16(packet, kTimestampOffset + 2) << 16;
}

/// The widest run of whole degrees without a block is the blind sector.
FieldOfView field_of_view_of(const std::bitset<360>& seen) {
  int widest = 0;
  int widest_end = 0;
  int run = 0;
  for (int i = 0; i < 720; ++i) {
    run = seen.test(static_cast<std::size_t>(i % 360)) ? 0 : run + 1;
    if (run <= widest) continue;
    widest = run;
    widest_end = i + 1;
  }
  return {widest_end % 360, (widest_end - widest + 360) % 360};
}

/// Models whose packets have this product byte.
std::string models_with_product(std::uint8_t product) {
  std::string names;
  for (const drivers::VelodyneModel model : drivers::velodyne_models()) {
    if (drivers::make_velodyne_sensor(model).product_byte != product || product == 0) continue;
    names += (names.empty() ? "" : " or ") + std::string(drivers::velodyne_model_name(model));
  }
  return names;
}

}  // namespace

double SensorFindings::packet_rate_hz() const {
  const double duration = duration_s();
  return packets > 1 && duration > 0.0 ? static_cast<double>(packets - 1) / duration : 0.0;
}

SensorInspector::SensorInspector(std::uint32_t address, std::uint16_t data_port) {
  findings_.address = address;
  findings_.data_port = data_port;
  head_.reserve(kDetectionPackets);
}

void SensorInspector::add_data(const drivers::Packet& packet) {
  note_time(packet);
  if (started_) {
    decode(packet);
    return;
  }
  head_.push_back(packet);
  if (head_.size() == kDetectionPackets) start();
}

void SensorInspector::add_telemetry(const drivers::Packet& packet) {
  // The first ones are not needed: telemetry repeats itself.
  if (assembler_) assembler_->add(packet);
}

void SensorInspector::note_time(const drivers::Packet& packet) {
  if (findings_.packets++ == 0) {
    findings_.first = findings_.last = packet.stamp;
    return;
  }
  const double pause_s = (packet.stamp - findings_.last).seconds();
  findings_.longest_pause_s = std::max(findings_.longest_pause_s, pause_s);
  if (pause_s > kSlowestRevolutionS) ++findings_.gaps;
  findings_.last = std::max(findings_.last, packet.stamp);
}

void SensorInspector::start() {
  started_ = true;
  findings_.detection = drivers::detect_velodyne(head_);
  const drivers::VelodyneDetection& detection = findings_.detection;
  if (!detection.candidates.empty()) {
    findings_.model = detection.model.value_or(detection.candidates.front());
    drivers::ScanAssemblerConfig config;
    config.min_range_m = 0.0;
    config.max_range_m = kLargestRangeM;
    config.min_coverage = 0.0;
    assembler_.emplace(drivers::make_velodyne_sensor(*findings_.model), config);
    if (is_hdl64e(*findings_.model)) status_reader_.emplace();
  }
  const auto data = std::find_if(head_.begin(), head_.end(), drivers::is_data_packet);
  if (data != head_.end() && !status_reader_)
    findings_.factory = FactoryBytes{data->data[kModeOffset], data->data[kProductOffset]};
  for (const drivers::Packet& packet : head_) decode(packet);
  head_.clear();
  head_.shrink_to_fit();
}

void SensorInspector::decode(const drivers::Packet& packet) {
  if (!assembler_) return;
  if (drivers::is_data_packet(packet)) {
    note_azimuths(packet);
    if (assembler_->sensor().has_clock) {
      clock_.add(timestamp_of(packet), packet.stamp,
                 std::llround(assembler_->status().packet_period_us * 1000.0));
    }
  }
  const bool complete = assembler_->add(packet);
  // The reader has to be notified of a loss before the next byte.
  if (status_reader_ && drivers::is_data_packet(packet)) add_status(packet);
  if (complete) take_scan();
}

void SensorInspector::note_azimuths(const drivers::Packet& packet) {
  for (std::size_t block = 0; block < drivers::kBlocksPerPacket; ++block) {
    const unsigned azimuth = load_le16(packet, block * kBlockSize + 2);
    if (azimuth < drivers::kAzimuthModulus) azimuths_.set(azimuth / 100);
  }
}

void SensorInspector::add_status(const drivers::Packet& packet) {
  if (assembler_->stats().lost_packets > lost_seen_) status_reader_->note_loss();
  lost_seen_ = assembler_->stats().lost_packets;
  const std::uint64_t cycles = status_reader_->counters().cycles;
  status_reader_->add(packet.data[kModeOffset], packet.data[kProductOffset]);
  if (status_reader_->counters().cycles == cycles || !status_reader_->readings()) return;
  if (!findings_.hdl64e) findings_.hdl64e.emplace();
  findings_.hdl64e->warnings |= status_reader_->readings()->warnings;
  findings_.hdl64e->temperature_degc.add(status_reader_->readings()->temperature_degc);
}

void SensorInspector::take_scan() {
  assembler_->take_scan(scan_);
  findings_.clock_source = scan_.clock_source;
  for (const core::Point& point : scan_.points) findings_.range_m.add(std::hypot(point.x, point.y, point.z));
  const double covers_deg = kFullCircleDeg - assembler_->status().blind_sector_deg;
  if (static_cast<double>(scan_.coverage_deg) < kCompleteShare * covers_deg) {
    ++findings_.partial_scans;
    last_complete_start_.reset();
    return;
  }
  ++findings_.complete_scans;
  findings_.points_per_scan.add(static_cast<double>(scan_.points.size()));
  if (last_complete_start_ && !scan_.after_time_jump && scan_.start > *last_complete_start_) {
    const double turns_per_minute = 60.0 / (scan_.start - *last_complete_start_).seconds();
    // A scan with a lost beginning has no valid start.
    if (scan_.missing_firings == 0) findings_.revolutions_per_minute.add(turns_per_minute);
  }
  last_complete_start_.reset();
  // The first scan, and one after a jump, does not begin at the cut.
  const bool begins_at_cut = scan_.sequence > 0 && !scan_.after_time_jump && scan_.missing_firings == 0;
  if (begins_at_cut) last_complete_start_ = scan_.start;
}

void SensorInspector::add_hints() {
  const drivers::VelodyneDetection& detection = findings_.detection;
  if (!findings_.factory) return;
  const FactoryBytes factory = *findings_.factory;
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(*findings_.model);
  const std::string named = models_with_product(factory.product);
  if (named.empty()) {
    findings_.hints.push_back(format(
        "product byte 0x%02X is of no known model: firmware older than factory bytes", factory.product));
  } else if (sensor.product_byte != factory.product) {
    findings_.hints.push_back(
        format("product byte 0x%02X is of %s, but a packet every %.0f us of a %s: pre-production "
               "firmware",
               factory.product, named.c_str(), detection.packet_period_us, sensor.name.c_str()));
  }
  const bool says_dual = factory.mode == 0x39 || factory.mode == 0x3B;
  if (says_dual != (detection.mode != drivers::ReturnMode::kSingle)) {
    findings_.hints.push_back(
        format("return mode byte 0x%02X disagrees with the blocks, which are of %s returns: the "
               "blocks are used",
               factory.mode, std::string(drivers::return_mode_name(detection.mode)).c_str()));
  }
}

SensorFindings SensorInspector::finish() {
  if (!started_) start();
  if (!assembler_) return std::move(findings_);
  if (assembler_->finish()) take_scan();
  findings_.stats = assembler_->stats();
  findings_.status = assembler_->status();
  if (findings_.revolutions_per_minute.empty() && findings_.status.revolutions_per_minute > 0.0)
    findings_.revolutions_per_minute.add(findings_.status.revolutions_per_minute);
  if (findings_.status.blind_sector_deg > 0.0) findings_.field_of_view = field_of_view_of(azimuths_);
  findings_.clock = clock_.findings();
  if (status_reader_) {
    if (!findings_.hdl64e) findings_.hdl64e.emplace();
    findings_.hdl64e->counters = status_reader_->counters();
    findings_.hdl64e->readings = status_reader_->readings();
    findings_.hdl64e->calibration = status_reader_->calibration();
  }
  add_hints();
  return std::move(findings_);
}

std::string address_text(std::uint32_t address) {
  return format("%u.%u.%u.%u", address >> 24, address >> 16 & 0xFFU, address >> 8 & 0xFFU, address & 0xFFU);
}

}  // namespace nilio::tools::inspect
