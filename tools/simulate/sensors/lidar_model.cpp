#include "tools/simulate/sensors/lidar_model.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/sensors/lidar_shots.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

namespace nilio::tools::simulate {

using core::SE3;
using core::Vector3;
using drivers::BlockContent;
using drivers::ReturnMode;
using drivers::VelodyneDataPacket;
using drivers::VelodyneModel;

namespace {

constexpr double kPi = std::numbers::pi;
/// Separates the noise's random numbers from others of the same seed.
constexpr std::uint64_t kNoiseStream = 0x4E6F697365;
constexpr std::uint64_t kStampStream = 0x5374616D70;
/// Cars are searched this far beyond the sensor's range.
constexpr double kCarMarginM = 10.0;
/// A retroreflector's halo is too weak beyond.
constexpr float kHaloRangeM = 60.0F;
/// Two surfaces in a beam give two echoes if they are farther apart than the pulse is long.
constexpr double kEchoSeparationM = 0.5;

drivers::PacketLayout layout_of(const drivers::VelodyneSensor& sensor, ReturnMode mode) {
  const drivers::PacketLayout* layout = sensor.layout(mode);
  if (layout != nullptr) return *layout;
  throw std::invalid_argument(sensor.name + " has no return mode " + std::string(return_mode_name(mode)));
}

/// Time from an azimuth step to an entry's firing.
std::int64_t offset_in_step_ns(const drivers::PacketLayout& layout, std::size_t block, std::size_t entry) {
  const auto step = static_cast<std::int64_t>(block / layout.blocks_per_azimuth);
  return layout.entries[block][entry].time_offset_ns - step * layout.azimuth_period_ns;
}

}  // namespace

LidarModel::LidarModel(drivers::VelodyneSensor sensor, const LidarModelConfig& config,
                       const VehicleTrajectory& trajectory, const RayScene& scene)
    : sensor_(std::move(sensor)),
      config_(config),
      layout_(layout_of(sensor_, config.return_mode)),
      timing_(
          sensor_, layout_,
          {config.seed, config.start, config.clock_offset, config.clock_drift_ppm, config.network_jitter}),
      trajectory_(trajectory),
      scene_(scene),
      optics_(optics_of(sensor_.model)) {
  // 4000 encoder positions.
  if (is_hdl64e(sensor_.model)) azimuth_unit_ = 9;
  if (has_status_stream(sensor_.model) && !config_.stream) config_.stream = Hdl64eStream(config.gps);
  for (const drivers::LaserCalibration& laser : sensor_.lasers)
    beams_.emplace_back(laser, sensor_.vertical_offset_across_beam);
  cast_beams_ = beams_;
  if (!config_.effects.empty() || config_.is_real()) {
    LidarErrors errors(sensor_, config_.realism, config_.effects, config_.seed);
    cast_beams_.clear();
    for (const drivers::LaserCalibration& laser : errors.lasers())
      cast_beams_.emplace_back(laser, sensor_.vertical_offset_across_beam);
    receiver_.emplace(sensor_, std::move(errors), config_.weather, config_.range_noise_m);
  }
  const double usable_s = trajectory.duration_s() - timing_.last_firing(0).seconds();
  packet_count_ =
      usable_s > 0.0 ? static_cast<std::uint64_t>(usable_s / timing_.packet_period().seconds()) + 1 : 0;
  while (packet_count_ > 0 && timing_.last_firing(packet_count_ - 1).seconds() > trajectory.duration_s())
    --packet_count_;
}

LidarModel::Motion LidarModel::motion_during(std::uint64_t packet) const {
  Motion motion;
  motion.start = timing_.step_time(packet, 0);
  const double duration_s = (timing_.last_firing(packet) - motion.start).seconds();
  const SE3 first = trajectory_.pose(motion.start.seconds()) * config_.T_base_lidar;
  const SE3 last = trajectory_.pose(motion.start.seconds() + duration_s) * config_.T_base_lidar;
  motion.T_world_lidar = first;
  motion.velocity = (last.translation - first.translation) / duration_s;
  motion.angular_velocity = core::so3_log(first.rotation.conjugate() * last.rotation) / duration_s;
  scene_.find_cars(motion.start.seconds(), first.translation, optics_.max_range_m + kCarMarginM, motion.cars);
  if (!config_.effects.has(Effect::kRetro)) return motion;
  const Eigen::Vector3f place = first.translation.cast<float>();
  for (const Retroreflector& retro : scene_.retroreflectors()) {
    if ((retro.centre - place).squaredNorm() < kHaloRangeM * kHaloRangeM)
      motion.retroreflectors.push_back(retro);
  }
  return motion;
}

LidarModel::Step LidarModel::step_at(std::uint64_t packet, std::size_t index) const {
  const core::Duration time =
      timing_.step_time(packet, index) + core::Duration{offset_in_step_ns(layout_, 0, 0)};
  const double turns = time.seconds() * config_.revolutions_per_minute / 60.0;
  const double units = (turns - std::floor(turns)) * drivers::kAzimuthModulus / azimuth_unit_;
  const auto reported =
      static_cast<std::uint16_t>(std::lround(units) * azimuth_unit_ % drivers::kAzimuthModulus);
  const bool exact = !config_.effects.has(Effect::kCalibration);
  return {packet, index, reported, (exact ? reported : units * azimuth_unit_) * (kPi / 18000.0)};
}

void LidarModel::set_last_bytes(std::uint64_t index, VelodyneDataPacket& packet) const {
  packet.timestamp_us = timestamp_us(timing_.sensor_clock(index));
  packet.factory_byte_1 = layout_.return_mode_byte;
  packet.factory_byte_2 = sensor_.product_byte;
  if (!sensor_.has_clock)
    packet.timestamp_us = static_cast<std::uint32_t>(random_word(config_.seed ^ kStampStream, index));
  if (!config_.stream) return;
  const drivers::Hdl64eStatusByte status =
      config_.stream->at(index, timing_.sensor_clock(Hdl64eStream::cycle_start(index)));
  packet.factory_byte_1 = status.type;
  packet.factory_byte_2 = status.value;
}

SimulatedPacket LidarModel::make_packet(std::uint64_t index) const {
  const Motion motion = motion_during(index);
  VelodyneDataPacket packet;
  set_last_bytes(index, packet);
  SimulatedPacket result;
  result.stamp = timing_.received(index);
  for (std::size_t s = 0; s < layout_.azimuth_steps(); ++s) {
    result.returns += fill_step(motion, step_at(index, s), packet);
  }
  result.payload = drivers::encode(packet);
  return result;
}

std::uint32_t LidarModel::fill_step(const Motion& motion, const Step& step,
                                    VelodyneDataPacket& packet) const {
  std::uint32_t returns = 0;
  const std::size_t first_block = step.index * layout_.blocks_per_azimuth;
  for (std::size_t b = first_block; b < first_block + layout_.blocks_per_azimuth; ++b) {
    packet.blocks[b].flag = layout_.block_flags[b];
    const BlockContent content = layout_.contents[b];
    if (content != BlockContent::kPadding) packet.blocks[b].azimuth = step.azimuth;
    if (content != BlockContent::kSingle && content != BlockContent::kLast) continue;
    for (std::size_t c = 0; c < drivers::kEntriesPerBlock; c += kRayGroup)
      returns += fill_group(motion, step, b, c, packet);
  }
  return returns;
}

/// Block of the same azimuth step and lasers as `like`, with another content.
std::size_t LidarModel::block_with(std::size_t like, BlockContent content) const {
  const std::size_t first = like - like % layout_.blocks_per_azimuth;
  for (std::size_t b = first; b < first + layout_.blocks_per_azimuth; ++b) {
    if (layout_.contents[b] == content && layout_.block_flags[b] == layout_.block_flags[like]) return b;
  }
  return like;
}

std::uint32_t LidarModel::fill_group(const Motion& motion, const Step& step, std::size_t block,
                                     std::size_t first, VelodyneDataPacket& packet) const {
  Shots shots = aim(motion, step, block, first);
  cast(motion, shots);
  Shots edge;
  Footprints parts;
  if (receiver_) {
    cast_footprints(motion, shots, step.packet, block * drivers::kEntriesPerBlock + first, parts);
  } else if (layout_.mode != ReturnMode::kSingle) {
    edge = shots;
    edge.aside_rad = optics_.divergence_rad;
    cast(motion, edge);
  }
  const std::size_t strongest = block_with(block, BlockContent::kStrongest);
  const std::size_t confidence = block_with(block, BlockContent::kConfidence);
  std::uint32_t count = 0;
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    const std::size_t c = first + i;
    const std::uint64_t word =
        random_word(config_.seed ^ kNoiseStream, step.packet, block * drivers::kEntriesPerBlock + c);
    const Returns found =
        receiver_ ? real_echoes(motion, shots, parts, i, word)
                  : echoes_of(shots.hits[i], edge.hits[i], *shots.beams[i], shots.azimuths[i], word);
    const auto pair = choose_returns(std::span(found.echoes).first(found.count));
    if (!pair) continue;
    ++count;
    packet.blocks[block].entries[c] = found.entries[pair->last];
    if (strongest != block) packet.blocks[strongest].entries[c] = found.entries[pair->strongest];
    if (confidence == block) continue;
    const std::uint32_t bits = confidence_bits(found.echoes[pair->last], found.echoes[pair->strongest]);
    packet.blocks[confidence].entries[c] = {static_cast<std::uint16_t>(bits & 0xFFFFU),
                                            static_cast<std::uint8_t>(bits >> 16U)};
  }
  return count;
}

LidarModel::Shots LidarModel::aim(const Motion& motion, const Step& step, std::size_t block,
                                  std::size_t first) const {
  const double advance_rad = 2.0 * kPi * config_.revolutions_per_minute / 60.0 *
                             (static_cast<double>(layout_.azimuth_period_ns) * 1e-9);
  const core::Duration step_offset = timing_.step_time(step.packet, step.index) - motion.start;
  Shots shots;
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    const drivers::PacketEntry& entry = layout_.entries[block][first + i];
    const LidarBeam& beam = cast_beams_[entry.laser];
    shots.beams[i] = &beam;
    shots.lasers[i] = entry.laser;
    shots.azimuths[i] = BeamAzimuth::of(step.actual_azimuth_rad + entry.azimuth_fraction * advance_rad -
                                        beam.azimuth_correction_rad());
    const core::Duration offset = step_offset + core::Duration{offset_in_step_ns(layout_, block, first + i)};
    const SE3 T_world_lidar = motion.pose(offset.seconds());
    shots.R_world_lidar[i] = T_world_lidar.rotation;
    shots.rays.origin[i] = (T_world_lidar * beam.origin(shots.azimuths[i])).cast<float>();
    shots.rays.time_s[i] = (motion.start + offset).seconds();
  }
  return shots;
}

/// Near an HDL-64E the decoder puts points beside the straight beam. The shot is redirected until the hit
/// surface is where the point will be decoded; without convergence, at the edge of an object, the return is
/// lost.
void LidarModel::cast(const Motion& motion, Shots& shots) const {
  constexpr int kAttempts = 5;
  constexpr double kSettledM = 1e-4;
  for (std::size_t i = 0; i < kRayGroup; ++i) shots.point(i, shots.beams[i]->direction(shots.azimuths[i]));
  std::array<bool, kRayGroup> moved{};
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    scene_.cast(shots.rays, static_cast<float>(optics_.max_range_m), motion.cars, shots.hits);
    moved.fill(false);
    for (std::size_t i = 0; i < kRayGroup; ++i) {
      const RayHit& hit = shots.hits[i];
      if (!hit.hit || !shots.beams[i]->bent()) continue;
      const Vector3 wanted = shots.beams[i]->direction_at(hit.distance_m, shots.azimuths[i]);
      moved[i] = (wanted - shots.directions[i]).norm() * hit.distance_m > kSettledM;
      if (moved[i]) shots.point(i, wanted);
    }
    if (std::none_of(moved.begin(), moved.end(), [](bool m) { return m; })) return;
  }
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    if (moved[i]) shots.hits[i] = {};
  }
}

Returns LidarModel::echoes_of(const RayHit& middle, const RayHit& edge, const LidarBeam& beam,
                              BeamAzimuth azimuth, std::uint64_t word) const {
  const bool two = middle.hit && edge.hit &&
                   std::abs(middle.distance_m - edge.distance_m) > static_cast<float>(kEchoSeparationM);
  // The edge between the two surfaces is anywhere in the beam.
  const double share = two ? 0.1 + 0.8 * to_unit_interval(mix_bits(word ^ 4U)) : 1.0;
  Returns found;
  measure(middle.hit ? middle : edge, share, beam, azimuth, word, found);
  if (two) measure(edge, 1.0 - share, beam, azimuth, mix_bits(word ^ 3U), found);
  return found;
}

/// Adds the echo of one surface if it is above the threshold.
void LidarModel::measure(const RayHit& hit, double share, const LidarBeam& beam, BeamAzimuth azimuth,
                         std::uint64_t word, Returns& found) const {
  if (!hit.hit) return;
  // Real surfaces are rough and reflect some light also at grazing incidence.
  const double reflectance =
      share * reflectivity(hit.material) * (0.25 + 0.75 * static_cast<double>(hit.incidence_cosine));
  // The signal decreases with the square of the distance; near the limit an echo is detected at random.
  const double limit = std::min(optics_.max_range_m, optics_.dark_range_m * std::sqrt(reflectance / 0.1));
  const double fading = 0.9 + 0.2 * to_unit_interval(mix_bits(word ^ 1U));
  const double margin = limit * fading / hit.distance_m;
  if (margin < 1.0) return;
  const double range = static_cast<double>(hit.distance_m) + config_.range_noise_m * to_gaussian(word);
  const double distance = beam.distance_for(range, azimuth);
  const double raw = std::round((distance - beam.far_correction_m()) / sensor_.distance_resolution_m);
  if (raw < 1.0 || raw > 65535.0) return;
  const double speckle = 0.94 + 0.12 * to_unit_interval(mix_bits(word ^ 2U));
  const double intensity = std::clamp(100.0 * reflectance * speckle, 1.0, 255.0);
  found.echoes[found.count] = {range, reflectance, margin * margin};
  found.entries[found.count] = {static_cast<std::uint16_t>(raw), beam.raw_intensity(intensity, raw)};
  ++found.count;
}

}  // namespace nilio::tools::simulate
