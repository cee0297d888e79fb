#include "tools/convert/kitti_raw_encoder.hpp"

#include "nilio/core/units.hpp"

#include "tools/common/statistics.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace nilio::tools::convert {

namespace {

constexpr std::size_t kColumnsPerPacket = 6;
// A revolution has 2154 to 2159 columns; more means that azimuths are not on the encoder's steps.
constexpr std::size_t kMaxColumns = 2500;
constexpr double kStepsPerColumn = 1.856;
constexpr double kMaxHeightErrorM = 0.005;
constexpr core::Duration kStreamGap{1'000'000};
constexpr core::Duration kTransmission{100'000};
// Points per ring used to identify its laser.
constexpr std::size_t kSamplesPerRing = 32;

struct LaserReturn {
  std::uint16_t laser = 0;
  /// From the scan's cut, 0..3999.
  int step = 0;
  double raw_distance = 0.0;
  /// Distance between the point and the laser's cone at its range, metres.
  double height_error_m = 0.0;
};

/// Inverse of the HDL-64E S2 user manual, appendix on calibration.
LaserReturn invert(const KittiPoint& point, std::uint16_t laser, const drivers::VelodyneSensor& sensor) {
  const drivers::LaserCalibration& c = sensor.lasers[laser];
  const double x = point.x;
  const double y = point.y;
  const double radius = std::max(std::hypot(x, y), std::abs(c.horizontal_offset_m) + 1e-3);
  const double azimuth_rad =
      -(std::atan2(y, x) - std::asin(c.horizontal_offset_m / radius)) + c.azimuth_correction_rad;
  constexpr double steps_per_radian = kEncoderSteps / (2.0 * std::numbers::pi);
  const int step = static_cast<int>(std::lround(azimuth_rad * steps_per_radian)) - kScanCutStep;
  const double horizontal = std::sqrt(radius * radius - c.horizontal_offset_m * c.horizontal_offset_m);
  const double sine = std::sin(c.elevation_rad);
  const double cosine = std::cos(c.elevation_rad);
  const double distance = (horizontal + c.vertical_offset_m * sine) / cosine;
  LaserReturn result;
  result.laser = laser;
  result.step = ((step % kEncoderSteps) + kEncoderSteps) % kEncoderSteps;
  result.raw_distance = std::round((distance - c.distance_correction_m) / sensor.distance_resolution_m);
  result.height_error_m =
      std::abs(distance * sine + c.vertical_offset_m * cosine - static_cast<double>(point.z));
  return result;
}

double ring_error(std::span<const KittiPoint> ring, std::uint16_t laser,
                  const drivers::VelodyneSensor& sensor) {
  std::vector<double> errors;
  const std::size_t stride = std::max<std::size_t>(1, ring.size() / kSamplesPerRing);
  for (std::size_t i = 0; i < ring.size(); i += stride) {
    errors.push_back(invert(ring[i], laser, sensor).height_error_m);
  }
  return errors.empty() ? 0.0 : median(std::move(errors));
}

/// Laser of each ring of the file. A ring without returns is missing in the file, so that rings are
/// identified by their cone in ascending order.
std::vector<std::uint16_t> assign_lasers(std::span<const KittiPoint> points,
                                         std::span<const std::uint16_t> rings, std::size_t ring_count,
                                         const drivers::VelodyneSensor& sensor) {
  std::vector<std::uint16_t> laser_of_rank(kHdlLasers);
  for (std::size_t laser = 0; laser < kHdlLasers; ++laser) {
    laser_of_rank[kHdlLasers - 1 - sensor.lasers[laser].ring] = static_cast<std::uint16_t>(laser);
  }
  if (ring_count == kHdlLasers) return laser_of_rank;
  std::vector<std::uint16_t> lasers;
  std::size_t rank = 0;
  for (std::size_t ring = 0; ring < ring_count; ++ring) {
    const auto [begin, end] = std::equal_range(rings.begin(), rings.end(), static_cast<std::uint16_t>(ring));
    const auto part = points.subspan(static_cast<std::size_t>(begin - rings.begin()),
                                     static_cast<std::size_t>(end - begin));
    // Each remaining ring needs a laser.
    const std::size_t last = kHdlLasers - (ring_count - ring);
    std::size_t best = rank;
    double best_error = ring_error(part, laser_of_rank[rank], sensor);
    for (std::size_t candidate = rank + 1; candidate <= last; ++candidate) {
      const double error = ring_error(part, laser_of_rank[candidate], sensor);
      if (error < best_error) {
        best = candidate;
        best_error = error;
      }
    }
    lasers.push_back(laser_of_rank[best]);
    rank = best + 1;
  }
  return lasers;
}

/// Columns on the occupied steps, and on those without a return.
std::vector<int> find_column_steps(const std::vector<LaserReturn>& returns) {
  std::vector<bool> occupied(kEncoderSteps, false);
  for (const LaserReturn& r : returns) occupied[static_cast<std::size_t>(r.step)] = true;
  std::vector<int> steps;
  const auto fill_to = [&steps](int step) {
    const int previous = steps.empty() ? -1 : steps.back();
    const int missing = static_cast<int>(std::lround((step - previous) / kStepsPerColumn)) - 1;
    if (step - previous <= 2) return;
    for (int k = 1; k <= missing; ++k) steps.push_back(previous + k * (step - previous) / (missing + 1));
  };
  for (int step = 0; step < kEncoderSteps; ++step) {
    if (!occupied[static_cast<std::size_t>(step)]) continue;
    fill_to(step);
    steps.push_back(step);
  }
  fill_to(kEncoderSteps);
  return steps;
}

std::vector<HdlColumn> make_columns(const std::vector<int>& steps, const KittiRawScan& scan) {
  std::vector<HdlColumn> columns(steps.size());
  const std::int64_t revolution_ns = (scan.end - scan.start).ns;
  const auto n = static_cast<std::int64_t>(steps.size());
  for (std::size_t j = 0; j < steps.size(); ++j) {
    const int azimuth = (steps[j] + kScanCutStep) % kEncoderSteps * kEncoderStepCentidegrees;
    columns[j].stamp = scan.start + core::Duration{revolution_ns * static_cast<std::int64_t>(j) / n};
    columns[j].azimuth_centidegrees = static_cast<std::uint16_t>(azimuth);
  }
  return columns;
}

core::Error not_raw(const KittiRawScan& scan, const std::string& what) {
  return core::Error{
      scan.path.string() + ": " + what +
      ": no raw scan of KITTI's HDL-64E; scans of the odometry benchmark are motion-compensated and "
      "cannot become packets again"};
}

core::Result<std::vector<LaserReturn>> invert_scan(std::span<const KittiPoint> points,
                                                   const KittiRawScan& scan,
                                                   const drivers::VelodyneSensor& sensor) {
  const std::vector<std::uint16_t> rings = kitti_rings(points);
  if (rings.empty()) return not_raw(scan, "no points");
  const std::size_t ring_count = rings.back() + std::size_t{1};
  if (ring_count > kHdlLasers) return not_raw(scan, std::to_string(ring_count) + " rings instead of 64");
  const std::vector<std::uint16_t> lasers = assign_lasers(points, rings, ring_count, sensor);
  std::vector<LaserReturn> returns;
  std::vector<double> errors;
  returns.reserve(points.size());
  errors.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    returns.push_back(invert(points[i], lasers[rings[i]], sensor));
    errors.push_back(returns.back().height_error_m);
  }
  const double error = median(std::move(errors));
  if (error > kMaxHeightErrorM) {
    return not_raw(scan, "points are " + std::to_string(std::lround(error * 1000.0)) +
                             " mm off the lasers' cones in the median");
  }
  return returns;
}

}  // namespace

std::vector<std::uint16_t> kitti_rings(std::span<const KittiPoint> points) {
  // Within a ring the horizontal offset of a laser reverses near points by at most 0.02 rad.
  constexpr double ring_end_rad = 0.1;
  std::vector<std::uint16_t> rings;
  rings.reserve(points.size());
  std::uint16_t ring = 0;
  double previous = 0.0;
  for (const KittiPoint& point : points) {
    // The sign bit, because the last point of a ring may be rounded to y = -0.
    double yaw = std::atan2(point.y, point.x);
    if (std::signbit(point.y)) yaw += 2.0 * std::numbers::pi;
    if (yaw < previous - ring_end_rad && ring < UINT16_MAX) ++ring;
    previous = yaw;
    rings.push_back(ring);
  }
  return rings;
}

core::Result<EncodedScan> encode_kitti_scan(std::span<const KittiPoint> points, const KittiRawScan& scan,
                                            const drivers::VelodyneSensor& sensor) {
  if (sensor.lasers.size() != kHdlLasers) return core::Error{sensor.name + ": is no sensor with 64 lasers"};
  const auto returns = invert_scan(points, scan, sensor);
  if (!returns) return returns.error();
  const std::vector<int> steps = find_column_steps(*returns);
  if (steps.size() > kMaxColumns) {
    return not_raw(scan, std::to_string(steps.size()) + " columns in one revolution");
  }
  std::vector<std::size_t> column_of_step(kEncoderSteps, 0);
  for (std::size_t j = 0; j < steps.size(); ++j) column_of_step[static_cast<std::size_t>(steps[j])] = j;
  EncodedScan encoded;
  encoded.columns = make_columns(steps, scan);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const LaserReturn& r = (*returns)[i];
    auto& entry = encoded.columns[column_of_step[static_cast<std::size_t>(r.step)]].returns[r.laser];
    if (r.raw_distance < 1.0 || r.raw_distance > static_cast<double>(UINT16_MAX)) {
      ++encoded.out_of_range;
    } else if (entry.distance != 0) {
      ++encoded.collisions;
    } else {
      entry.distance = static_cast<std::uint16_t>(r.raw_distance);
      entry.intensity =
          static_cast<std::uint8_t>(std::lround(255.0F * std::clamp(points[i].reflectance, 0.0F, 1.0F)));
      ++encoded.encoded;
    }
  }
  return encoded;
}

bool HdlPacketStream::add(const HdlColumn& column) {
  const bool gap = !pending_.empty() && column.stamp - pending_.back().stamp > kStreamGap;
  if (gap && !write_packet()) return false;
  pending_.push_back(column);
  return pending_.size() < kColumnsPerPacket || write_packet();
}

bool HdlPacketStream::finish() {
  const bool written = pending_.empty() || write_packet();
  return writer_.close() && written;
}

void HdlPacketStream::set_status_bytes(drivers::VelodyneDataPacket& packet) const {
  // The HDL-64E has no factory bytes there but a status stream of 16 types in turn: GPS time, GPS state,
  // temperature, firmware, calibration. Only the time is available here.
  constexpr std::string_view status_types = "HMSDNYGTV1234567";
  const std::int64_t seconds = pending_.front().stamp.ns / kNanosecondsPerSecond;
  const std::chrono::sys_seconds time{std::chrono::seconds(seconds)};
  const std::chrono::year_month_day date{std::chrono::floor<std::chrono::days>(time)};
  const std::array<std::int64_t, 6> values{seconds / 3600 % 24,
                                           seconds / 60 % 60,
                                           seconds % 60,
                                           static_cast<unsigned>(date.day()),
                                           static_cast<unsigned>(date.month()),
                                           static_cast<int>(date.year()) % 100};
  const std::size_t type = packets_ % status_types.size();
  packet.factory_byte_1 = static_cast<std::uint8_t>(status_types[type]);
  packet.factory_byte_2 = type < values.size() ? static_cast<std::uint8_t>(values[type]) : std::uint8_t{0};
}

bool HdlPacketStream::write_packet() {
  const core::Time first = pending_.front().stamp;
  while (pending_.size() < kColumnsPerPacket) {
    HdlColumn empty;
    empty.stamp = pending_.back().stamp + core::Duration{sensor_.single().azimuth_period_ns};
    empty.azimuth_centidegrees = static_cast<std::uint16_t>(
        (pending_.back().azimuth_centidegrees + 2 * kEncoderStepCentidegrees) % drivers::kAzimuthModulus);
    pending_.push_back(empty);
  }
  drivers::VelodyneDataPacket packet;
  for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
    const HdlColumn& column = pending_[b / sensor_.single().blocks_per_azimuth];
    packet.blocks[b].flag = sensor_.single().block_flags[b];
    packet.blocks[b].azimuth = column.azimuth_centidegrees;
    for (std::size_t e = 0; e < drivers::kEntriesPerBlock; ++e) {
      packet.blocks[b].entries[e] = column.returns[sensor_.single().entries[b][e].laser];
    }
  }
  constexpr std::int64_t nanoseconds_per_hour = 3'600'000'000'000;
  packet.timestamp_us = static_cast<std::uint32_t>(first.ns % nanoseconds_per_hour / 1000);
  set_status_bytes(packet);
  const core::Time sent =
      pending_.back().stamp + core::Duration{sensor_.single().azimuth_period_ns} + kTransmission;
  pending_.clear();
  ++packets_;
  return writer_.write(sent, 2368, drivers::encode(packet));
}

}  // namespace nilio::tools::convert
