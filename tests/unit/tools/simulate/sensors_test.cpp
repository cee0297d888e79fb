#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/detect.hpp"

#include "tests/support/tools/simulate_room.hpp"
#include "tools/simulate/sensors/position_model.hpp"

#include <cstddef>
#include <map>
#include <numbers>
#include <vector>

using namespace nilio;
using namespace nilio::tools::simulate;
using core::SE3;
using core::Vector3;
using drivers::BlockContent;
using drivers::ReturnMode;
using drivers::VelodyneModel;

namespace {

constexpr double kDriveS = 0.5;

/// True shot of one laser.
struct Shot {
  std::int64_t time_ns = 0;
  /// Calibrated azimuth of the beam, not rounded.
  double azimuth_rad = 0.0;
};

/// Expected accuracy of one model in one mode.
struct Expectation {
  double time_us = 1.0;
  /// Azimuth error of a decoded beam: half the unit of reported azimuths, and the rounding of the rate used
  /// for interpolation.
  double reported_rad = 0.005 * nilio::kRadiansPerDegree;
  double interpolated_rad = 0.003 * nilio::kRadiansPerDegree;
  /// Lateral displacement of points near an HDL-64E, m.
  double bend_m = 0.0;
  /// Time in which the decoder estimates the pauses of a VLS-128's firing sequences.
  double settled_us = 0.0;
  core::ClockSource clock = core::ClockSource::kPpsLocked;
};

Expectation expectation_of(const drivers::VelodyneSensor& sensor, ReturnMode mode, double rpm) {
  Expectation expected;
  if (sensor.model == VelodyneModel::kVls128) {
    // The random pause; a packet has only one to three azimuths; and the decoder counts the advance over a
    // firing sequence without its pause.
    expected.time_us = 3.5;
    expected.settled_us = 200.0;
    expected.interpolated_rad = (mode == ReturnMode::kSingle ? 0.006 : 0.014) * nilio::kRadiansPerDegree +
                                1e-5 * rpm * nilio::kRadiansPerDegree;
  }
  if (sensor.lasers.size() == 64) {
    expected.reported_rad = 0.045 * nilio::kRadiansPerDegree;
    expected.interpolated_rad = 1e-5;
    expected.clock = sensor.has_clock ? core::ClockSource::kPpsLocked : core::ClockSource::kHost;
    if (sensor.lasers[0].near_distance_correction_x_m != 0.0) expected.bend_m = 0.06;
  }
  return expected;
}

/// All shots by ring, in order of time.
std::map<std::uint16_t, std::vector<Shot>> true_shots(const LidarModel& model, double rpm) {
  const drivers::PacketLayout& layout = model.layout();
  std::map<std::uint16_t, std::vector<Shot>> shots;
  const double rate_rad_s = rpm / 60.0 * 2.0 * std::numbers::pi;
  for (std::uint64_t p = 0; p < model.packet_count(); ++p) {
    for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
      if (layout.contents[b] != BlockContent::kSingle && layout.contents[b] != BlockContent::kLast) continue;
      const std::size_t step = b / layout.blocks_per_azimuth;
      const std::int64_t step_ns = model.timing().step_time(p, step).ns;
      const std::int64_t first_ns = layout.entries[0][0].time_offset_ns;
      for (const drivers::PacketEntry& entry : layout.entries[b]) {
        const drivers::LaserCalibration& laser = model.sensor().lasers[entry.laser];
        const std::int64_t time_ns =
            step_ns + entry.time_offset_ns - static_cast<std::int64_t>(step) * layout.azimuth_period_ns;
        // An HDL-64E's calibration is for the azimuth at the first shot of a column.
        const bool turning = model.sensor().lasers.size() != 64;
        const double azimuth_s = static_cast<double>(turning ? time_ns : step_ns + first_ns) * 1e-9;
        shots[laser.ring].push_back({time_ns, rate_rad_s * azimuth_s - laser.azimuth_correction_rad});
      }
    }
  }
  for (auto& [ring, of_ring] : shots) {
    std::sort(of_ring.begin(), of_ring.end(),
              [](const Shot& a, const Shot& b) { return a.time_ns < b.time_ns; });
  }
  return shots;
}

const Shot& nearest(const std::vector<Shot>& shots, std::int64_t time_ns) {
  const auto after = std::lower_bound(shots.begin(), shots.end(), time_ns,
                                      [](const Shot& shot, std::int64_t t) { return shot.time_ns < t; });
  if (after == shots.begin()) return *after;
  const auto before = after - 1;
  return after == shots.end() || time_ns - before->time_ns < after->time_ns - time_ns ? *before : *after;
}

/// Beam of the manual, in the sensor's frame.
Vector3 beam_origin(const drivers::VelodyneSensor& sensor, const drivers::LaserCalibration& laser,
                    double azimuth_rad) {
  const bool across = sensor.vertical_offset_across_beam;
  const double range = across ? -laser.vertical_offset_m * std::sin(laser.elevation_rad) : 0.0;
  const double side = laser.horizontal_offset_m;
  return {range * std::cos(azimuth_rad) + side * std::sin(azimuth_rad),
          side * std::cos(azimuth_rad) - range * std::sin(azimuth_rad),
          laser.vertical_offset_m * (across ? std::cos(laser.elevation_rad) : 1.0)};
}

double angle_between(double a, double b) { return std::abs(std::remainder(a - b, 2.0 * std::numbers::pi)); }

struct PointCheck {
  const tests::RoomWorld& world;
  const LidarModel& model;
  const LidarModelConfig& config;
  Expectation expected;
  std::map<std::uint16_t, std::vector<Shot>> shots;
  std::vector<drivers::LaserCalibration> laser_of_ring;
  std::size_t wrong_times = 0;
  std::size_t wrong_angles = 0;
  std::size_t wrong_ranges = 0;
  std::size_t points = 0;

  void look(const core::Point& point, std::int64_t time_ns) {
    ++points;
    const Shot& shot = nearest(shots[point.ring], time_ns);
    if (static_cast<double>(time_ns) < expected.settled_us * 1000.0) return;
    if (std::abs(static_cast<double>(shot.time_ns - time_ns)) > expected.time_us * 1000.0) ++wrong_times;
    const drivers::LaserCalibration& laser = laser_of_ring[point.ring];
    const Vector3 p(point.x, point.y, point.z);
    const Vector3 origin = beam_origin(model.sensor(), laser, shot.azimuth_rad);
    const Vector3 ray = p - origin;
    const double slack = expected.bend_m / ray.norm() + 3e-4 / ray.norm();
    const double azimuth = std::atan2(-ray.y(), ray.x());
    const double elevation = std::asin(ray.z() / ray.norm());
    if (angle_between(azimuth, shot.azimuth_rad) >
            expected.reported_rad + expected.interpolated_rad + slack / std::cos(elevation) ||
        std::abs(elevation - laser.elevation_rad) > 1e-6 + slack)
      ++wrong_angles;
    if (!in_range(origin, ray, shot.time_ns)) ++wrong_ranges;
  }

  /// Checks a point against the analytic hall along the decoded beam, or along its edge for two returns.
  [[nodiscard]] bool in_range(const Vector3& origin, const Vector3& ray, std::int64_t time_ns) const {
    const SE3 T_world_lidar =
        world.trajectory.pose(static_cast<double>(time_ns) * 1e-9) * config.T_base_lidar;
    const double range = ray.norm();
    const Vector3 direction = ray / range;
    const Vector3 aside = Vector3(direction.y(), -direction.x(), 0.0).normalized();
    const double divergence = model.sensor().lasers.size() == 64 ? 0.002 : 0.003;
    const double tolerance = 0.5 * model.sensor().distance_resolution_m + 0.001 +
                             (expected.bend_m > 0.0 && std::abs(range - 25.04) < 0.1 ? 0.08 : 0.0);
    for (const double edge : {0.0, divergence}) {
      const Vector3 from = T_world_lidar * origin;
      // The decoded beam is slightly beside the true one and may hit another surface between two corners.
      constexpr int kTurns = 100;
      double nearest = std::numeric_limits<double>::infinity();
      double farthest = 0.0;
      for (int i = 0; i <= 2 * kTurns; ++i) {
        // 0, 1, -1, 2, -2, ...
        const double turn = (expected.interpolated_rad + 5e-5) * (i % 2 == 0 ? -i / 2 : (i + 1) / 2) / kTurns;
        const Vector3 along = (direction + (edge + turn) * aside).normalized();
        const double hit = world.room.cast(from, T_world_lidar.rotation * along);
        nearest = std::min(nearest, hit);
        farthest = std::max(farthest, hit);
        if (range > nearest - tolerance && range < farthest + tolerance) return true;
      }
      if (config.return_mode == ReturnMode::kSingle) break;
    }
    return false;
  }
};

void check_sensor(const tests::RoomWorld& world, VelodyneModel kind, ReturnMode mode, double rpm) {
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(kind);
  INFO(sensor.name << " " << drivers::return_mode_name(mode) << ", " << rpm << " rpm");
  LidarModelConfig config = tests::room_config(mode);
  config.revolutions_per_minute = rpm;
  const LidarModel model(sensor, config, world.trajectory, world.scene);
  const PositionModel positions(kind, config.gps, config.T_base_lidar, model.timing(), world.trajectory);
  drivers::ScanAssemblerConfig assembly;
  assembly.min_coverage = 0.0;
  assembly.min_range_m = 0.1;
  assembly.max_range_m = 300.0;
  drivers::ScanAssembler assembler(sensor, assembly);
  std::vector<core::Scan> scans;
  std::vector<drivers::Packet> seen;
  std::uint64_t returns = 0;
  bool exact = true;
  for (std::uint64_t i = 0; i < model.packet_count(); ++i) {
    const SimulatedPacket packet = model.make_packet(i);
    returns += packet.returns;
    const auto fields = drivers::decode(packet.payload);
    exact = exact && fields && drivers::encode(*fields) == packet.payload;
    if (seen.size() < 64) seen.push_back(tests::as_packet(packet.stamp, packet.payload));
    if (assembler.add(tests::as_packet(packet.stamp, packet.payload)))
      assembler.take_scan(scans.emplace_back());
    if (i % kDataPacketsPerPosition != 0 || !sends_position_packets(kind)) continue;
    const SimulatedPosition position = positions.make_packet(i / kDataPacketsPerPosition);
    assembler.add(tests::as_packet(position.stamp, position.payload));
  }
  if (assembler.finish()) assembler.take_scan(scans.emplace_back());
  CHECK(exact);

  const drivers::VelodyneDetection detection = drivers::detect_velodyne(seen);
  INFO(detection.evidence);
  CHECK(detection.agrees_with(kind));
  CHECK(detection.mode == mode);

  const drivers::ScanAssemblerStats& stats = assembler.stats();
  CHECK(assembler.status().mode == mode);
  CHECK(stats.firings == model.packet_count() * model.layout().firings_per_packet());
  CHECK(stats.firings_in_scans == stats.firings);
  CHECK(stats.lost_packets + stats.bad_length + stats.duplicate_packets + stats.late_packets == 0);
  CHECK(stats.time_jumps + stats.host_clock_jumps + stats.mode_changes + stats.firings_bad == 0);
  // The cut is half a revolution after the start.
  REQUIRE(static_cast<double>(scans.size()) == std::ceil(kDriveS * rpm / 60.0 + 0.5));
  // A hall is closed: only dark surfaces and ranges beyond the packet's are lost.
  CHECK(returns > 9 * stats.firings / 10);
  if (mode == ReturnMode::kSingle) CHECK(stats.points == returns);
  if (mode != ReturnMode::kSingle) CHECK(stats.points > returns + returns / 1000);

  PointCheck check{world, model, config, expectation_of(sensor, mode, rpm), true_shots(model, rpm), {}};
  check.laser_of_ring.resize(sensor.lasers.size());
  for (const drivers::LaserCalibration& laser : sensor.lasers) check.laser_of_ring[laser.ring] = laser;
  // Without a clock in the sensor, times are arrival times minus a packet's duration.
  const std::int64_t lateness_ns = sensor.has_clock ? 0
                                                    : kTransmission.ns + model.timing().last_firing(0).ns -
                                                          model.layout().packet_period_ns;
  for (const core::Scan& scan : scans) {
    CHECK(scan.clock_source == check.expected.clock);
    for (const core::Point& point : scan.points)
      check.look(point, (scan.start - tests::kRoomStart).ns + point.time_offset_ns - lateness_ns);
  }
  CHECK(check.points == stats.points);
  CHECK(check.wrong_times == 0);
  CHECK(check.wrong_angles == 0);
  CHECK(check.wrong_ranges == 0);
}

}  // namespace

TEST_CASE("every model and return mode decodes to the true points at their true times without loss",
          "[simulate_sensors]") {
  const tests::RoomWorld world = tests::make_room_world(tests::room_drive(kDriveS));
  for (const VelodyneModel kind : drivers::velodyne_models()) {
    for (const drivers::PacketLayout& layout : drivers::make_velodyne_sensor(kind).layouts)
      check_sensor(world, kind, layout.mode, 600.0);
  }
}

TEST_CASE("the minimum and maximum rotation rates decode as well", "[simulate_sensors]") {
  const tests::RoomWorld world = tests::make_room_world(tests::room_drive(kDriveS));
  for (const double rpm : {300.0, 1200.0}) {
    check_sensor(world, VelodyneModel::kVlp16, ReturnMode::kDual, rpm);
    check_sensor(world, VelodyneModel::kHdl32e, ReturnMode::kSingle, rpm);
    check_sensor(world, VelodyneModel::kVls128, ReturnMode::kSingle, rpm);
    check_sensor(world, VelodyneModel::kHdl64eS3, ReturnMode::kDual, rpm);
  }
}
