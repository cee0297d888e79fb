#include "nilio/drivers/velodyne_decoder.hpp"

#include "azimuth_steps.hpp"
#include "firing_decoder.hpp"
#include "little_endian.hpp"
#include "packet_clock.hpp"
#include "velodyne_layout.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::drivers {
namespace {

/// A scan is closed after this whatever the azimuth does: the slowest revolution lasts 0.2 s.
constexpr std::int64_t kLongestScanNs = 300'000'000;

std::int64_t floor_divide(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

int cut_azimuth(double degrees) {
  if (!std::isfinite(degrees)) return 0;
  const double turn = std::fmod(degrees, 360.0);
  return static_cast<int>(std::lround(turn < 0.0 ? (turn + 360.0) * 100.0 : turn * 100.0)) % kAzimuthModulus;
}

/// No scan gets more points than this, so that buffers never grow.
std::size_t scan_capacity(const VelodyneSensor& sensor) {
  const std::int64_t packets = kLongestScanNs / std::max<std::int64_t>(sensor.packet_period_ns, 1) + 2;
  return static_cast<std::size_t>(packets) * kBlocksPerPacket * kEntriesPerBlock;
}

}  // namespace

struct ScanAssembler::State {
  State(const VelodyneSensor& sensor, const ScanAssemblerConfig& config)
      : clock(config.time_source, sensor.packet_period_ns),
        azimuths(sensor),
        decoder(sensor, config.min_range_m, config.max_range_m),
        cut(cut_azimuth(config.cut_azimuth_deg)),
        capacity(scan_capacity(sensor)) {
    current.points.reserve(capacity);
    completed.points.reserve(capacity);
  }

  PacketClock clock;
  AzimuthReader azimuths;
  FiringDecoder decoder;
  int cut;
  std::size_t capacity;

  core::Scan current;
  core::Scan completed;
  /// A scan became complete in the packet at hand.
  bool has_completed = false;
  /// Time line of the clock; the scan under assembly has firings when it is open.
  bool open = false;
  std::int64_t start_ns = 0;
  std::int64_t end_ns = 0;
  double covered = 0.0;

  /// Azimuth of the last step, counted on from the cut over all revolutions.
  bool has_azimuth = false;
  std::uint16_t last_azimuth = 0;
  std::int64_t last_step_ns = 0;
  std::int64_t unwrapped = 0;
  /// The last step's share of the coverage.
  double last_advance = 0.0;
  std::int64_t scan_revolution = 0;
  std::int64_t pause_ns = 0;
};

ScanAssembler::ScanAssembler(VelodyneSensor sensor, const ScanAssemblerConfig& config)
    : sensor_(std::move(sensor)), config_(config), state_(std::make_unique<State>(sensor_, config_)) {}

ScanAssembler::ScanAssembler(ScanAssembler&&) noexcept = default;
ScanAssembler& ScanAssembler::operator=(ScanAssembler&&) noexcept = default;
ScanAssembler::~ScanAssembler() = default;

/// Counts what is no packet to decode.
bool ScanAssembler::admit(const Packet& packet) {
  if (packet.size == kPositionPacketSize && !packet.truncated) return false;
  if (packet.size != kDataPacketSize || packet.truncated) {
    ++stats_.bad_length;
    return false;
  }
  ++stats_.packets;
  // A model without a product byte has something else in these two bytes.
  const bool says_dual = sensor_.product_byte != 0 && sensor_.return_mode_byte != kDualReturn &&
                         packet.data[kReturnModeOffset] == kDualReturn &&
                         packet.data[kProductOffset] == sensor_.product_byte;
  if (says_dual) ++stats_.dual_return;
  return !says_dual;
}

bool ScanAssembler::add(const Packet& packet) {
  State& state = *state_;
  state.has_completed = false;
  if (!admit(packet)) return false;
  const std::uint32_t timestamp_us = load_u32(packet.data.data() + kTimestampOffset);
  const std::uint16_t first_azimuth = load_u16(packet.data.data() + kAzimuthOffset);
  // A jump changes what the clock adds to times, so the scan so far is closed by a copy of the clock before
  // it.
  const PacketClock clock_before = state.clock;
  const PacketArrival arrival = state.clock.arrive(timestamp_us, first_azimuth, packet.stamp, state.pause_ns);
  switch (arrival.order) {
    case PacketOrder::kDuplicate:
      ++stats_.duplicate_packets;
      return false;
    case PacketOrder::kReordered:
      ++stats_.reordered_packets;
      return false;
    case PacketOrder::kJump: {
      ++stats_.time_jumps;
      const PacketClock clock_now = std::exchange(state.clock, clock_before);
      close_scan();
      state.clock = clock_now;
      state.has_azimuth = false;
      break;
    }
    case PacketOrder::kNext:
      stats_.lost_packets += arrival.lost;
      if (state.open) state.current.lost_packets += arrival.lost;
      break;
  }

  const PacketAzimuths azimuths = state.azimuths.read({packet.data.data(), kDataPacketSize});
  stats_.bad_block += azimuths.bad_blocks;
  state.pause_ns = azimuths.pause_ns;
  state.decoder.set_rate(azimuths.rate);
  for (std::size_t step = 0; step < azimuths.count; ++step) {
    if (!azimuths.steps[step].usable) continue;
    const std::int64_t time_ns = arrival.first_firing_ns + azimuths.steps[step].pause_ns;
    track_azimuth(azimuths.steps[step].azimuth, time_ns + state.decoder.first_firing_ns(step), azimuths.rate);
    add_step(packet, step, time_ns);
  }
  return state.has_completed;
}

/// Continues the azimuth over all revolutions. Where packets are missing, the rate and the time tell how far
/// it went.
void ScanAssembler::track_azimuth(std::uint16_t azimuth, std::int64_t time_ns, float rate) {
  State& state = *state_;
  if (!state.has_azimuth) {
    state.has_azimuth = true;
    state.unwrapped = (static_cast<int>(azimuth) - state.cut + kAzimuthModulus) % kAzimuthModulus;
    state.scan_revolution = 0;
    state.last_advance = rate;
  } else {
    const double periods =
        static_cast<double>(time_ns - state.last_step_ns) / static_cast<double>(sensor_.azimuth_period_ns);
    const int difference = static_cast<int>(azimuth) - static_cast<int>(state.last_azimuth);
    const double turns = std::round((periods * static_cast<double>(rate) - difference) / kAzimuthModulus);
    const std::int64_t advance = difference + static_cast<std::int64_t>(turns) * kAzimuthModulus;
    state.unwrapped += advance;
    const bool regular = advance <= largest_regular_advance(rate);
    state.last_advance = regular ? static_cast<double>(advance) : static_cast<double>(rate);
  }
  state.last_azimuth = azimuth;
  state.last_step_ns = time_ns;
}

bool ScanAssembler::must_cut(std::int64_t time_ns) const {
  const State& state = *state_;
  // Only one scan can be handed out per packet: a second cut waits for the next packet.
  if (!state.open || state.has_completed) return false;
  const bool crossed = floor_divide(state.unwrapped, kAzimuthModulus) > state.scan_revolution;
  const bool too_long = time_ns - state.start_ns > kLongestScanNs;
  const std::size_t step_points = kEntriesPerBlock * sensor_.blocks_per_azimuth;
  // The rest of this packet has room too, should its cut have to wait.
  const bool full =
      state.current.points.size() + kBlocksPerPacket * kEntriesPerBlock + step_points > state.capacity;
  return crossed || too_long || full;
}

void ScanAssembler::add_step(const Packet& packet, std::size_t step, std::int64_t time_ns) {
  State& state = *state_;
  const std::int64_t first_ns = time_ns + state.decoder.first_firing_ns(step);
  if (must_cut(first_ns)) close_scan();
  if (!state.open) open_scan(first_ns);
  state.end_ns = time_ns + state.decoder.last_firing_ns(step);
  state.covered += state.last_advance;
  state.current.received_ns = packet.received_ns;

  std::vector<core::Point>& points = state.current.points;
  const auto scan_time_ns = static_cast<std::int32_t>(time_ns - state.start_ns);
  const std::size_t blocks = sensor_.blocks_per_azimuth;
  std::size_t count = points.size();
  points.resize(count + blocks * kEntriesPerBlock);
  for (std::size_t block = step * blocks; block < (step + 1) * blocks; ++block) {
    const FiringDecoder::Counts decoded = state.decoder.decode_block(
        packet.data.data() + block * kBlockSize, block, scan_time_ns, std::span(points).subspan(count));
    count += decoded.points;
    stats_.points += decoded.points;
    stats_.points_out_of_range += decoded.out_of_range;
  }
  points.resize(count);
}

void ScanAssembler::open_scan(std::int64_t time_ns) {
  State& state = *state_;
  core::Scan& scan = state.current;
  std::vector<core::Point> points = std::move(scan.points);
  points.clear();
  points.reserve(state.capacity);
  scan = core::Scan{};
  scan.points = std::move(points);
  state.open = true;
  state.start_ns = time_ns;
  state.covered = 0.0;
  state.scan_revolution = floor_divide(state.unwrapped, kAzimuthModulus);
}

/// Ends the scan under assembly: it becomes the completed one, or is dropped and counted when it covers too
/// little.
void ScanAssembler::close_scan() {
  State& state = *state_;
  if (!state.open) return;
  state.open = false;
  const double coverage_deg = std::clamp(state.covered / 100.0, 0.0, 360.0);
  if (coverage_deg < config_.min_coverage_deg) {
    ++stats_.partial_scans;
    return;
  }
  core::Scan& scan = state.current;
  state.clock.freeze();
  scan.sequence = stats_.scans++;
  scan.start = state.clock.to_time(state.start_ns);
  scan.end = state.clock.to_time(state.end_ns);
  scan.beam_spacing_rad = sensor_.beam_spacing_rad;
  scan.coverage_deg = static_cast<float>(coverage_deg);
  std::swap(state.completed, state.current);
  state.has_completed = true;
}

bool ScanAssembler::finish() {
  state_->has_completed = false;
  close_scan();
  return state_->has_completed;
}

void ScanAssembler::take_scan(core::Scan& scan) {
  std::swap(state_->completed, scan);
  state_->completed.points.clear();
  state_->completed.points.reserve(state_->capacity);
}

}  // namespace nilio::drivers
