#pragma once

#include "nilio/core/time.hpp"
#include "nilio/core/tracking.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace nilio::core {

/// One LiDAR return in the sensor's ROS frame (x forward, y left, z up), metres.
struct Point {
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;
  /// Reflectivity 0..255 as the sensor reports it.
  float intensity = 0.0F;
  /// Firing time relative to Scan::start, nanoseconds.
  std::int32_t time_offset_ns = 0;
  /// Rank of the beam, 0 = lowest elevation; from 256 on a second LiDAR's, and so forth.
  std::uint16_t ring = 0;
  /// Of a firing with two returns: 1 = last, 2 = strongest, or second strongest where the strongest is the
  /// last. 0 = the sensor sends one return.
  std::uint16_t return_kind = 0;
};

/// Beams with a higher `ring` are not calibrated.
inline constexpr std::size_t kMaxCalibratedBeams = 256;

/// Corrections that are added to the range, elevation and azimuth (counterclockwise) of a beam.
struct BeamCorrection {
  double range_m = 0.0;
  double elevation_rad = 0.0;
  double azimuth_rad = 0.0;
};

/// One revolution of the sensor, or the received part of it.
struct Scan {
  /// Number of the completed scan, from 0.
  std::uint64_t sequence = 0;
  /// Times of the first and the last firing; the pose of a scan refers to `end`.
  Time start;
  Time end;
  /// Sensor frame; not sorted. Capacity is kept when a scan object is reused.
  std::vector<Point> points;
  /// True if the points are already deskewed (KITTI odometry).
  bool motion_compensated = false;
  /// Vertical angle between neighbouring beams (median), rad; decides the plane voxel size.
  float beam_spacing_rad = 0.0F;
  /// Azimuth that the firings surround, degrees, 0..360: the field of view without missing sectors. Gaps as
  /// short as evenly lost packets leave them count as covered; see `missing_firings`.
  float coverage_deg = 0.0F;
  /// Packets missing inside the scan, by the sensor's time stamps.
  std::uint32_t lost_packets = 0;
  /// Laser firings missing from the scan, in lost packets or damaged blocks.
  std::uint32_t missing_firings = 0;
  ClockSource clock_source = ClockSource::kHost;
  /// The sensor's or the host's clock was set between the previous scan and this one.
  bool after_time_jump = false;
  /// How far the host's clock was set ahead meanwhile, where the sensor's clock went on and tells.
  Duration clock_step;
  /// CLOCK_MONOTONIC when the scan's last packet was received, when it was popped from the ring, and when the
  /// scan was complete (ns; 0 = unknown).
  std::int64_t received_ns = 0;
  std::int64_t popped_ns = 0;
  std::int64_t completed_ns = 0;
};

/// One inertial measurement (trivially copyable, for rings) in the IMU's own frame (x forward, y left, z up
/// unless the extrinsic says otherwise).
struct ImuSample {
  Time stamp;
  /// rad/s.
  std::array<double, 3> angular_velocity{};
  /// Specific force, m/s^2: +9.81 on z when level and at rest.
  std::array<double, 3> linear_acceleration{};
};

}  // namespace nilio::core
