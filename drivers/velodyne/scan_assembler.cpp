#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/velodyne/packet_bytes.hpp"
#include "drivers/velodyne/scan_assembler_impl.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::drivers {
namespace {

/// Longest scan: the slowest revolution lasts 0.2 s.
constexpr std::int64_t kLongestScanNs = 300'000'000;
/// scan_capacity() is so many times the size of a scan at the usual 10 revolutions a second.
constexpr std::size_t kUsualScansInCapacity = 3;
/// Relative tolerance of the firing period between firmwares.
constexpr double kPeriodTolerance = 0.3;
constexpr std::uint32_t kPeriodsAveraged = 64;
/// A gap of so many packets is counted right at the tolerance of the period.
constexpr std::uint32_t kLargestGapMeasured = 1;
constexpr int kPacketsToChangeMode = 3;

int cut_azimuth(double degrees) {
  if (!std::isfinite(degrees)) return 0;
  const double turn = std::fmod(degrees, 360.0);
  return static_cast<int>(std::lround(turn < 0.0 ? (turn + 360.0) * 100.0 : turn * 100.0)) % kAzimuthModulus;
}

}  // namespace

std::size_t scan_capacity(const VelodyneSensor& sensor) {
  std::int64_t period_ns = sensor.single().packet_period_ns;
  for (const PacketLayout& layout : sensor.layouts) period_ns = std::min(period_ns, layout.packet_period_ns);
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
  // Inputs of the fuzzer are shorter; the page faults of a whole scan would take most of their time.
  period_ns = std::max<std::int64_t>(period_ns, kLongestScanNs / 64);
#endif
  const std::int64_t packets = kLongestScanNs / std::max<std::int64_t>(period_ns, 1) + 2;
  return static_cast<std::size_t>(packets) * kBlocksPerPacket * kEntriesPerBlock;
}

ScanAssembler::Impl::Impl(VelodyneSensor sensor, const ScanAssemblerConfig& config)
    : sensor_(std::move(sensor)),
      config_(config),
      clock_(config.time_source, sensor_.has_clock, sensor_.has_ptp),
      cutter_(cut_azimuth(config.cut_azimuth_deg), kLongestScanNs),
      has_status_stream_(sensor_.lasers.size() == kHdl64eLasers),
      capacity_(scan_capacity(sensor_)),
      buffer_capacity_(capacity_ + config.more_points) {
  for (const PacketLayout& layout : sensor_.layouts)
    decoders_.emplace_back(sensor_, layout, azimuth_table_, config.min_range_m, config.max_range_m,
                           config.returns);
  std::size_t index = 0;
  for (std::size_t i = 0; i < sensor_.layouts.size(); ++i) {
    if (config.return_mode == sensor_.layouts[i].mode) index = i;
  }
  use_layout(index);
  for (std::vector<core::Point>* points : {&current_.points, &completed_.points, &spare_}) {
    points->reserve(buffer_capacity_);
    // Touches the memory of a usual scan now, so that the first scans do not wait for page faults.
    points->resize(buffer_capacity_ / kUsualScansInCapacity);
    points->clear();
  }
}

void ScanAssembler::Impl::use_layout(std::size_t index) {
  layout_index_ = index;
  packet_period_ns_ = static_cast<double>(layout().packet_period_ns);
  azimuth_period_ns_ = layout().azimuth_period_ns;
  periods_measured_ = 0;
  azimuths_.set_layout(layout());
  clock_.set_packet_period(layout().packet_period_ns);
}

/// True for data packets; evaluates position packets and counts all others.
bool ScanAssembler::Impl::admit(const Packet& packet) {
  if (is_position_packet(packet)) {
    ++stats_.position_packets;
    on_position_packet(packet);
    return false;
  }
  if (!is_data_packet(packet)) {
    ++stats_.bad_length;
    return false;
  }
  ++stats_.packets;
  return true;
}

void ScanAssembler::Impl::on_position_packet(const Packet& packet) {
  const std::optional<PositionPacket> position =
      parse_position_packet(std::span(packet.data).first(kPositionPacketSize));
  if (!position) return;
  GpsReport report;
  report.pulse_locked = position->pps == PpsState::kLocked;
  const std::optional<NmeaFix> fix = parse_nmea(position->nmea(), packet.stamp);
  if (fix && fix->valid) report.utc = fix->utc;
  clock_.on_gps_report(report, packet.stamp);
}

/// An HDL-64E reports its clock's state in its data packets.
void ScanAssembler::Impl::on_status_byte(const PacketArrival& arrival, const Packet& packet) {
  if (arrival.gap_packets > 0 || arrival.refutes || arrival.order == PacketOrder::kJump)
    status_stream_.note_loss();
  status_stream_.add(packet.data[kReturnModeOffset], packet.data[kProductOffset]);
  const std::optional<Hdl64eReadings>& readings = status_stream_.readings();
  // Once per cycle is enough.
  if (!readings || packet.data[kReturnModeOffset] != 'V') return;
  GpsReport report;
  report.pulse_locked = readings->gps == Hdl64eGps::kPulseAndTime || readings->gps == Hdl64eGps::kPulseOnly;
  const bool has_time = readings->gps == Hdl64eGps::kPulseAndTime || readings->gps == Hdl64eGps::kTimeOnly;
  if (has_time) report.utc = readings->clock;
  clock_.on_gps_report(report, packet.stamp);
}

/// Follows the return mode, which can be changed at the sensor at any time.
void ScanAssembler::Impl::follow_mode(std::span<const std::uint8_t> payload) {
  if (config_.return_mode || sensor_.layouts.size() == 1) return;
  const std::optional<ReturnMode> mode = return_mode_of(payload, sensor_);
  if (!mode || *mode == layout().mode) {
    other_mode_packets_ = 0;
    return;
  }
  // A single packet may be damaged; but the first packet decides the initial mode.
  if (stats_.firings > 0 && ++other_mode_packets_ < kPacketsToChangeMode) return;
  other_mode_packets_ = 0;
  for (std::size_t i = 0; i < sensor_.layouts.size(); ++i) {
    if (sensor_.layouts[i].mode != *mode) continue;
    if (stats_.firings > 0) ++stats_.mode_changes;
    use_layout(i);
  }
}

bool ScanAssembler::Impl::add(const Packet& packet) {
  has_completed_ = false;
  if (!admit(packet)) return false;
  PacketArrival arrival = arrive(packet);
  if (arrival.order == PacketOrder::kConfirmed) {
    is_holding_ = false;
    process(held_, clock_.confirm(pause_ns_));
    arrival = arrive(packet);
  }
  if (arrival.refutes) discard_held();
  if (arrival.order == PacketOrder::kUnconfirmed) {
    held_ = packet;
    is_holding_ = true;
  } else {
    process(packet, arrival);
  }
  return has_completed_;
}

PacketArrival ScanAssembler::Impl::arrive(const Packet& packet) {
  const std::span<const std::uint8_t> payload = std::span(packet.data).first(kDataPacketSize);
  return clock_.arrive(load_le32(payload.data() + kTimestampOffset),
                       load_le16(payload.data() + kAzimuthOffset), packet.stamp, pause_ns_,
                       sensor_.has_clock ? 0 : payload_key(payload));
}

/// Counts the held packet: no other packet agrees with its time stamp.
void ScanAssembler::Impl::discard_held() {
  if (!std::exchange(is_holding_, false)) return;
  ++stats_.damaged_stamps;
  stats_.firings += layout().firings_per_packet();
  stats_.firings_bad += layout().firings_per_packet();
  current_.missing_firings += layout().firings_per_packet();
}

void ScanAssembler::Impl::process(const Packet& packet, PacketArrival arrival) {
  if (arrival.order == PacketOrder::kDuplicate) {
    ++stats_.duplicate_packets;
    return;
  }
  Current current;
  current.payload = std::span(packet.data).first(kDataPacketSize);
  current.received_ns = packet.received_ns;
  const std::uint16_t first_azimuth = load_le16(packet.data.data() + kAzimuthOffset);
  follow_mode(current.payload);
  stats_.firings += layout().firings_per_packet();
  current.line_ns = arrival.line_ns + config_.stamp_offset_ns;
  if (arrival.order == PacketOrder::kLate) return add_late(current);
  if (arrival.order == PacketOrder::kJump) {
    ++stats_.time_jumps;
    close_scan();
    cutter_.restart();
    after_time_jump_ = true;
    pause_ns_ = 0;
    const std::uint32_t timestamp_us = load_le32(packet.data.data() + kTimestampOffset);
    current.line_ns = clock_.restart(timestamp_us, first_azimuth, packet.stamp) + config_.stamp_offset_ns;
  } else {
    if (arrival.host_jump) ++stats_.host_clock_jumps;
    measure_period(arrival);
    account_gap(arrival, first_azimuth);
  }
  if (has_status_stream_) on_status_byte(arrival, packet);
  current.azimuths = azimuths_.read(current.payload, arrival.since_previous_ns, blind_);
  for (std::size_t step = 0; step < current.azimuths.count; ++step) {
    if (current.azimuths.steps[step].usable) azimuth_table_.prefetch(current.azimuths.steps[step].azimuth);
  }
  add_in_order(current);
}

/// Measures the firing period from the time between packets, which hold a fixed number of firings.
void ScanAssembler::Impl::measure_period(const PacketArrival& arrival) {
  if (!sensor_.measured_period || arrival.since_previous_ns == 0) return;
  if (arrival.gap_packets > kLargestGapMeasured || arrival.refutes) return;
  const auto nominal_ns = static_cast<double>(layout().packet_period_ns);
  const double measured_ns = static_cast<double>(arrival.since_previous_ns - pause_ns_) /
                             static_cast<double>(arrival.gap_packets + 1);
  if (std::abs(measured_ns - nominal_ns) > kPeriodTolerance * nominal_ns) return;
  periods_measured_ = std::min(periods_measured_ + 1, kPeriodsAveraged);
  packet_period_ns_ += (measured_ns - packet_period_ns_) / periods_measured_;
  azimuth_period_ns_ = std::llround(packet_period_ns_ / static_cast<double>(layout().azimuth_steps()));
  azimuths_.set_period(azimuth_period_ns_);
  clock_.set_packet_period(std::llround(packet_period_ns_));
}

/// Distinguishes lost packets from a sector in which the sensor does not fire.
void ScanAssembler::Impl::account_gap(const PacketArrival& arrival, std::uint16_t first_azimuth) {
  if (arrival.gap_packets == 0) return;
  std::uint32_t wrongly_counted = 0;
  const bool known_place = cutter_.has_azimuth() && first_azimuth < kAzimuthModulus && rate_ > 0.0F;
  BlindSector::Gap gap;
  gap.from = cutter_.last_azimuth();
  gap.to = first_azimuth;
  gap.packets = arrival.gap_packets;
  gap.time_ns = arrival.line_ns;
  gap.revolution_ns = rate_ > 0.0F ? std::llround(kAzimuthModulus / static_cast<double>(rate_) *
                                                  static_cast<double>(azimuth_period_ns_))
                                   : 0;
  if (known_place && blind_.explains(gap, wrongly_counted)) {
    stats_.lost_packets -= std::min<std::uint64_t>(stats_.lost_packets, wrongly_counted);
    return;
  }
  stats_.lost_packets += arrival.gap_packets;
  if (cutter_.state() == ScanCutter::State::kEmpty) return;
  current_.lost_packets += arrival.gap_packets;
  current_.missing_firings += arrival.gap_packets * layout().firings_per_packet();
}

void ScanAssembler::Impl::add_in_order(Current& current) {
  const PacketAzimuths& azimuths = current.azimuths;
  rate_ = azimuths.rate;
  pause_ns_ = azimuths.pause_ns;
  // The decoder's fractions of an azimuth step refer to the nominal period.
  const auto measured = static_cast<float>(static_cast<double>(layout().azimuth_period_ns) /
                                           static_cast<double>(azimuth_period_ns_));
  decoders_[layout_index_].set_rate(azimuths.rate * measured);
  if (azimuths.gap_from_step > 0) {
    blind_.on_gap_inside_packet(azimuths.steps[azimuths.gap_from_step - 1].azimuth,
                                azimuths.steps[azimuths.gap_from_step].azimuth);
  } else if (azimuths.steps[0].usable) {
    blind_.on_firing(azimuths.steps[0].azimuth);
  }
  for (std::size_t step = 0; step < azimuths.count; ++step) {
    if (azimuths.steps[step].usable) {
      add_step(current, step);
    } else {
      stats_.firings_bad += layout().firings_per_azimuth;
      current_.missing_firings += layout().firings_per_azimuth;
    }
  }
  // Ends the scan now instead of with the next packet, which arrives later.
  if (!has_completed_ && cutter_.next_step_cuts(rate_)) {
    close_scan();
    cutter_.end_early();
    prepare_scan();
  }
}

std::int64_t ScanAssembler::Impl::step_time_ns(const Current& current, std::size_t step) const {
  return current.line_ns + current.azimuths.steps[step].pause_ns +
         static_cast<std::int64_t>(step) * azimuth_period_ns_;
}

bool ScanAssembler::Impl::has_room() const {
  // Leaves room for the rest of this packet, in case its cut has to wait for the next packet.
  constexpr std::size_t kPacketPoints = kBlocksPerPacket * kEntriesPerBlock;
  return current_.points.size() + 2 * kPacketPoints + kEntriesPerBlock <= capacity_;
}

void ScanAssembler::Impl::add_step(const Current& current, std::size_t step) {
  const std::int64_t step_ns = step_time_ns(current, step);
  // Contradictory azimuths can look like a blind sector, with later steps timed before the scan.
  if (cutter_.state() == ScanCutter::State::kFilling &&
      step_ns + decoder().first_firing_ns() < cutter_.start_ns()) {
    stats_.firings_late += layout().firings_per_azimuth;
    return;
  }
  // Only one scan can be delivered per packet: a second cut waits for the next packet.
  const ScanCutter::Action action =
      cutter_.evaluate(current.azimuths.steps[step].azimuth, step_ns + decoder().first_firing_ns(), rate_,
                       azimuth_period_ns_, has_room(), !has_completed_);
  if (action != ScanCutter::Action::kAppend) {
    const bool is_prepared = cutter_.state() == ScanCutter::State::kBetween;
    if (action != ScanCutter::Action::kOpen) close_scan();
    cutter_.open();
    if (!is_prepared) prepare_scan();
    end_ns_ = cutter_.start_ns();
    open_firings_ = 0;
  }
  coverage_.add(current.azimuths.steps[step].azimuth, rate_);
  end_ns_ = std::max(end_ns_, step_ns + decoder().last_firing_ns());
  current_.received_ns = current.received_ns;
  decode_step(current, step, step_ns);
}

void ScanAssembler::Impl::decode_step(const Current& current, std::size_t step, std::int64_t step_ns) {
  const FiringDecoder::Counts decoded = decoder().decode_step(
      current.payload, step, static_cast<std::int32_t>(step_ns - cutter_.start_ns()), scratch_);
  // Decodes into a buffer in the cache: growing the scan first would write every point twice.
  const auto first = scratch_.begin();
  current_.points.insert(current_.points.end(), first, first + static_cast<std::ptrdiff_t>(decoded.points));
  open_firings_ += layout().firings_per_azimuth;
  stats_.points += decoded.points;
  stats_.points_out_of_range += decoded.out_of_range;
}

/// Adds an overtaken packet: firings inside the open scan's time go there, the others count as late.
void ScanAssembler::Impl::add_late(Current& current) {
  ++stats_.late_packets;
  stats_.lost_packets -= std::min<std::uint64_t>(stats_.lost_packets, 1);
  AzimuthReader reader = azimuths_;
  current.azimuths = reader.read(current.payload, 0, blind_);
  const bool open = cutter_.state() == ScanCutter::State::kFilling;
  bool belongs = false;
  for (std::size_t step = 0; step < current.azimuths.count; ++step) {
    const std::int64_t step_ns = step_time_ns(current, step);
    const bool inside = open && step_ns + decoder().first_firing_ns() >= cutter_.start_ns() &&
                        step_ns + decoder().last_firing_ns() <= end_ns_ && has_room();
    if (!current.azimuths.steps[step].usable) {
      stats_.firings_bad += layout().firings_per_azimuth;
    } else if (!inside) {
      stats_.firings_late += layout().firings_per_azimuth;
    } else {
      decode_step(current, step, step_ns);
      coverage_.add(current.azimuths.steps[step].azimuth, rate_);
      current_.missing_firings -=
          std::min<std::uint32_t>(current_.missing_firings, layout().firings_per_azimuth);
      belongs = true;
    }
  }
  if (belongs) current_.lost_packets -= std::min(current_.lost_packets, 1U);
}

void ScanAssembler::Impl::prepare_scan() {
  std::vector<core::Point> points = std::move(current_.points);
  points.clear();
  points.reserve(buffer_capacity_);
  current_ = core::Scan{};
  current_.points = std::move(points);
  coverage_.restart();
}

/// Ends the scan under assembly: it becomes the completed scan, or is dropped and counted for too little
/// coverage.
void ScanAssembler::Impl::close_scan() {
  const std::uint64_t firings = std::exchange(open_firings_, 0);
  if (firings == 0) return;
  const double packet_deg = static_cast<double>(rate_) * static_cast<double>(layout().azimuth_steps()) * 0.01;
  const double coverage_deg = coverage_.covered_deg(packet_deg, blind_);
  if (coverage_deg < config_.min_coverage * (360.0 - blind_.width_deg())) {
    ++stats_.partial_scans;
    stats_.firings_discarded += firings;
    return;
  }
  core::Scan& scan = current_;
  scan.clock_step = clock_.update_shift(cutter_.start_ns(), end_ns_);
  stats_.firings_in_scans += firings;
  scan.sequence = stats_.scans++;
  scan.start = clock_.to_time(cutter_.start_ns());
  scan.end = clock_.to_time(end_ns_);
  scan.beam_spacing_rad = sensor_.beam_spacing_rad;
  scan.coverage_deg = static_cast<float>(coverage_deg);
  scan.clock_source = clock_.source();
  scan.after_time_jump = std::exchange(after_time_jump_, false) || scan.clock_step.ns > 0;
  std::swap(completed_, current_);
  has_completed_ = true;
}

bool ScanAssembler::Impl::finish() {
  has_completed_ = false;
  discard_held();
  close_scan();
  cutter_.restart();
  return has_completed_;
}

void ScanAssembler::Impl::take_scan(core::Scan& scan) {
  std::swap(completed_, scan);
  // The first scan swapped in has no buffer yet.
  if (completed_.points.capacity() < buffer_capacity_) completed_.points.swap(spare_);
  completed_.points.clear();
  completed_.points.reserve(buffer_capacity_);
}

ScanAssemblerStatus ScanAssembler::Impl::status() const {
  ScanAssemblerStatus status;
  status.mode = layout().mode;
  status.revolutions_per_minute = cutter_.revolutions_per_minute();
  status.packet_period_us = packet_period_ns_ * 1e-3;
  status.blind_sector_deg = blind_.width_deg();
  status.clock_source = clock_.source();
  status.clock_offset_s = static_cast<double>(clock_.shift_ns()) * 1e-9;
  status.clock_drift_ppm = clock_.drift() * 1e6;
  return status;
}

ScanAssembler::ScanAssembler(VelodyneSensor sensor, const ScanAssemblerConfig& config)
    : impl_(std::make_unique<Impl>(std::move(sensor), config)) {}

ScanAssembler::ScanAssembler(ScanAssembler&&) noexcept = default;
ScanAssembler& ScanAssembler::operator=(ScanAssembler&&) noexcept = default;
ScanAssembler::~ScanAssembler() = default;

bool ScanAssembler::add(const Packet& packet) { return impl_->add(packet); }
bool ScanAssembler::finish() { return impl_->finish(); }
void ScanAssembler::take_scan(core::Scan& scan) { impl_->take_scan(scan); }
const ScanAssemblerStats& ScanAssembler::stats() const { return impl_->stats(); }
ScanAssemblerStatus ScanAssembler::status() const { return impl_->status(); }
std::uint64_t ScanAssembler::open_firings() const { return impl_->open_firings(); }
const Hdl64eStatusReader* ScanAssembler::hdl64e_status() const { return impl_->hdl64e_status(); }
const VelodyneSensor& ScanAssembler::sensor() const { return impl_->sensor(); }
std::optional<core::Time> ScanAssembler::time_of(std::uint32_t timestamp_us) const {
  return impl_->time_of(timestamp_us);
}

}  // namespace nilio::drivers
