#include "simulation/lidar_model.hpp"

#include "simulation/random.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numbers>
#include <utility>
#include <vector>

namespace nilio::tools::simulation {

using core::SE3;
using core::Vector3;
using drivers::VelodyneDataPacket;

namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::int64_t kHourUs = 3'600'000'000;
/// From the last firing to the host's time stamp.
constexpr core::Duration kTransmission{100'000};
/// Tells the noise's random numbers from others of the same seed.
constexpr std::uint64_t kNoiseStream = 0x4E6F697365;
/// Cars farther than this are not looked for.
constexpr double kCarRangeM = 110.0;

/// The HDL-64E sends its state in the two factory bytes of 16 successive packets: time, GPS receiver,
/// temperature, firmware (HDL-64E S2 manual, appendix E).
void set_status_bytes(core::Time time, std::uint64_t index, VelodyneDataPacket& packet) {
  const auto seconds = static_cast<std::time_t>(time.ns / 1'000'000'000);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  static constexpr std::array<char, 16> types{'H', 'M', 'S', 'D', 'N', 'Y', 'G', 'T',
                                              'V', '1', '2', '3', '4', '5', '6', '7'};
  const std::array<int, 16> values{utc.tm_hour,
                                   utc.tm_min,
                                   utc.tm_sec,
                                   utc.tm_mday,
                                   utc.tm_mon + 1,
                                   utc.tm_year % 100,
                                   'A',
                                   40,
                                   0x20,
                                   0,
                                   0,
                                   0,
                                   0,
                                   0,
                                   0,
                                   0};
  packet.factory_byte_1 = static_cast<std::uint8_t>(types[index % 16]);
  packet.factory_byte_2 = static_cast<std::uint8_t>(values[index % 16]);
}

}  // namespace

/// The sensor's motion over one packet: a millisecond, in which it is straight to a micrometre.
struct LidarModel::Motion {
  double start_s = 0.0;
  SE3 T_world_lidar;
  Vector3 velocity;          ///< in world
  Vector3 angular_velocity;  ///< in the sensor's frame
  std::vector<NearbyCar> cars;

  [[nodiscard]] SE3 pose(double offset_s) const {
    return {T_world_lidar.rotation * core::so3_exp(angular_velocity * offset_s),
            T_world_lidar.translation + velocity * offset_s};
  }
};

LidarModel::LidarModel(drivers::VelodyneSensor sensor, const LidarModelConfig& config,
                       const VehicleTrajectory& trajectory, const RayScene& scene)
    : sensor_(std::move(sensor)), config_(config), trajectory_(trajectory), scene_(scene) {
  if (sensor_.model == drivers::VelodyneModel::kHdl64eS2) {
    // 4000 encoder positions; 120 m at 80 % reflectivity.
    azimuth_step_ = 9;
    max_range_m_ = 120.0;
  }
  for (const drivers::LaserCalibration& laser : sensor_.lasers) {
    const double cosine = std::cos(laser.elevation_rad);
    const double sine = std::sin(laser.elevation_rad);
    const double v = laser.vertical_offset_m;
    const bool across = sensor_.vertical_offset_across_beam;
    // Azimuth 0 is +x of the ROS frame; the horizontal offset is then towards +y.
    beams_.push_back({{across ? -v * sine : 0.0, laser.horizontal_offset_m, across ? v * cosine : v},
                      {cosine, 0.0, sine}});
  }
  std::int32_t last = 0;
  for (const auto& block : sensor_.single().entries) {
    for (const drivers::PacketEntry& entry : block) last = std::max(last, entry.time_offset_ns);
  }
  duration_of_packet_s_ = last * 1e-9;
  const double usable = trajectory.duration_s() - duration_of_packet_s_;
  const double period = static_cast<double>(sensor_.single().packet_period_ns) * 1e-9;
  packet_count_ = usable > 0.0 ? static_cast<std::uint64_t>(usable / period) + 1 : 0;
}

LidarModel::Motion LidarModel::motion_during(double packet_time_s) const {
  const SE3 first = trajectory_.pose(packet_time_s) * config_.T_base_lidar;
  const SE3 last = trajectory_.pose(packet_time_s + duration_of_packet_s_) * config_.T_base_lidar;
  Motion motion;
  motion.start_s = packet_time_s;
  motion.T_world_lidar = first;
  motion.velocity = (last.translation - first.translation) / duration_of_packet_s_;
  motion.angular_velocity = core::so3_log(first.rotation.conjugate() * last.rotation) / duration_of_packet_s_;
  scene_.find_cars(packet_time_s, first.translation, kCarRangeM, motion.cars);
  return motion;
}

std::uint16_t LidarModel::block_azimuth(double time_s) const {
  const double turns = time_s * config_.revolutions_per_minute / 60.0;
  const double steps = (turns - std::floor(turns)) * drivers::kAzimuthModulus / azimuth_step_;
  return static_cast<std::uint16_t>(std::lround(steps) * azimuth_step_ % drivers::kAzimuthModulus);
}

SimulatedPacket LidarModel::make_packet(std::uint64_t index) const {
  // The packet's clock counts whole microseconds; firings are cast at the times that it says.
  const std::int64_t time_us = static_cast<std::int64_t>(index) * sensor_.single().packet_period_ns / 1000;
  const core::Time time = config_.start + core::Duration{time_us * 1000};
  const Motion motion = motion_during(static_cast<double>(time_us) * 1e-6);

  VelodyneDataPacket packet;
  packet.timestamp_us = static_cast<std::uint32_t>(time.ns / 1000 % kHourUs);
  packet.factory_byte_1 = sensor_.single().return_mode_byte;
  packet.factory_byte_2 = sensor_.product_byte;
  if (sensor_.model == drivers::VelodyneModel::kHdl64eS2) set_status_bytes(time, index, packet);
  for (std::size_t block = 0; block < drivers::kBlocksPerPacket; ++block)
    cast_block(motion, index, block, packet);

  SimulatedPacket result;
  result.stamp = time + core::Duration::from_seconds(duration_of_packet_s_) + kTransmission;
  result.payload = drivers::encode(packet);
  for (const VelodyneDataPacket::Block& block : packet.blocks) {
    for (const VelodyneDataPacket::Entry& entry : block.entries)
      result.returns += entry.distance != 0 ? 1U : 0U;
  }
  return result;
}

void LidarModel::cast_block(const Motion& motion, std::uint64_t index, std::size_t block,
                            VelodyneDataPacket& packet) const {
  const double step_s = static_cast<double>(sensor_.single().azimuth_period_ns) * 1e-9;
  const std::size_t azimuth_step = block / sensor_.single().blocks_per_azimuth;
  const double block_offset_s = static_cast<double>(azimuth_step) * step_s;
  VelodyneDataPacket::Block& out = packet.blocks[block];
  out.flag = sensor_.single().block_flags[block];
  out.azimuth = block_azimuth(motion.start_s + block_offset_s);
  const double advance_rad = 2.0 * kPi * config_.revolutions_per_minute / 60.0 * step_s;

  for (std::size_t first = 0; first < drivers::kEntriesPerBlock; first += kRayGroup) {
    RayGroup rays;
    for (std::size_t i = 0; i < kRayGroup; ++i) {
      const drivers::PacketEntry& entry = sensor_.single().entries[block][first + i];
      const Beam& beam = beams_[entry.laser];
      const double azimuth = out.azimuth * (kPi / 18000.0) + entry.azimuth_fraction * advance_rad -
                             sensor_.lasers[entry.laser].azimuth_correction_rad;
      const double c = std::cos(azimuth);
      const double s = std::sin(azimuth);
      const auto turn = [&](const Vector3& p) {
        return Vector3(c * p.x() + s * p.y(), c * p.y() - s * p.x(), p.z());
      };
      const double offset_s = entry.time_offset_ns * 1e-9;
      const SE3 T_world_lidar = motion.pose(offset_s);
      rays.origin[i] = (T_world_lidar * turn(beam.origin)).cast<float>();
      rays.direction[i] = (T_world_lidar.rotation * turn(beam.direction)).cast<float>();
      rays.time_s[i] = motion.start_s + offset_s;
    }
    std::array<RayHit, kRayGroup> hits;
    scene_.cast(rays, static_cast<float>(max_range_m_), motion.cars, hits);
    for (std::size_t i = 0; i < kRayGroup; ++i) {
      const double correction =
          sensor_.lasers[sensor_.single().entries[block][first + i].laser].distance_correction_m;
      out.entries[first + i] =
          measure(hits[i], correction, index, block * drivers::kEntriesPerBlock + first + i);
    }
  }
}

VelodyneDataPacket::Entry LidarModel::measure(const RayHit& hit, double distance_correction_m,
                                              std::uint64_t packet_index, std::uint64_t firing) const {
  if (!hit.hit) return {};
  const std::uint64_t word = random_word(config_.seed ^ kNoiseStream, packet_index, firing);
  // Real surfaces are rough: some light comes back also at grazing incidence.
  const double echo = reflectivity(hit.material) * (0.25 + 0.75 * static_cast<double>(hit.incidence_cosine));
  // The signal falls with the square of the distance; near the limit an echo is sometimes seen, sometimes
  // not.
  const double limit = std::min(max_range_m_, dark_range_m_ * std::sqrt(echo / 0.1));
  const double fading = 0.9 + 0.2 * to_unit_interval(mix_bits(word ^ 1U));
  if (hit.distance_m > limit * fading) return {};
  const double distance = static_cast<double>(hit.distance_m) + config_.range_noise_m * to_gaussian(word);
  const double raw = std::round((distance - distance_correction_m) / sensor_.distance_resolution_m);
  if (raw < 1.0 || raw > 65535.0) return {};
  const double speckle = 0.94 + 0.12 * to_unit_interval(mix_bits(word ^ 2U));
  const double intensity = std::clamp(100.0 * echo * speckle, 1.0, 255.0);
  return {static_cast<std::uint16_t>(raw), static_cast<std::uint8_t>(intensity)};
}

}  // namespace nilio::tools::simulation
