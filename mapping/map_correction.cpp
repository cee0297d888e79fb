#include "mapping/map_correction.hpp"

#include <algorithm>
#include <cmath>

#include "mapping/crc32c.hpp"

namespace nilio::mapping {

namespace {

using core::Error;
using core::Result;
using core::SE3;
using core::Vector3;

constexpr std::uint64_t kMagic = 0x534F'504F'494C'494E;  // "NILIOPOS", little endian
constexpr std::uint16_t kVersion = 1;
constexpr std::uint16_t kGnssVersion = 2;  // with positions
constexpr std::size_t kPoseBytes = 4 + 7 * 8;
constexpr std::size_t kPositionBytes = 4 + 9 * 8 + 1;
constexpr std::size_t kLoopBytes = 2 * 4 + 7 * 8 + 36 * 8 + 2 * 4 + 6 * 8 + 2;

void put_loop(const Loop& loop, ByteWriter& out) {
  const PlaceAlignment& alignment = loop.alignment;
  out.put(loop.reference);
  out.put(loop.moving);
  put_pose(alignment.T_reference_moving, out);
  for (int i = 0; i < 36; ++i) out.put(alignment.information(i / 6, i % 6));
  out.put(alignment.compared);
  out.put(loop.inliers);
  for (const double value : {alignment.overlap, alignment.support, alignment.contradiction, loop.drift_square,
                             loop.support_share, loop.ambiguity})
    out.put(value);
  out.put(static_cast<std::uint8_t>(loop.is_twofold));
  out.put(static_cast<std::uint8_t>(loop.verdict));
}

bool get_loop(ByteReader& in, Loop& loop) {
  PlaceAlignment& alignment = loop.alignment;
  loop.reference = in.get<std::uint32_t>();
  loop.moving = in.get<std::uint32_t>();
  alignment.T_reference_moving = get_pose(in);
  for (int i = 0; i < 36; ++i) alignment.information(i / 6, i % 6) = in.get<double>();
  alignment.compared = in.get<std::uint32_t>();
  loop.inliers = in.get<std::uint32_t>();
  for (double* const value : {&alignment.overlap, &alignment.support, &alignment.contradiction,
                              &loop.drift_square, &loop.support_share, &loop.ambiguity})
    *value = in.get<double>();
  loop.is_twofold = in.get<std::uint8_t>() != 0;
  loop.verdict = static_cast<LoopVerdict>(in.get<std::uint8_t>());
  return is_valid_pose(alignment.T_reference_moving) && loop.reference < loop.moving &&
         static_cast<std::size_t>(loop.verdict) < kLoopVerdicts && loop.is_verified() &&
         alignment.information.allFinite() && alignment.information.llt().info() == Eigen::Success;
}

void put_datum(const Datum& datum, ByteWriter& out) {
  for (const double value : {datum.latitude_deg, datum.longitude_deg, datum.altitude_m, datum.heading_deg})
    out.put(value);
}

/// False for an impossible one.
bool get_datum(ByteReader& in, Datum& datum) {
  for (double* const value :
       {&datum.latitude_deg, &datum.longitude_deg, &datum.altitude_m, &datum.heading_deg})
    *value = in.get<double>();
  return std::abs(datum.latitude_deg) <= 90.0 && std::abs(datum.longitude_deg) <= 180.0 &&
         std::abs(datum.altitude_m) < 1e6 && std::abs(datum.heading_deg) <= 360.0;
}

void put_gnss(const MapGnss& gnss, ByteWriter& out) {
  put_datum(gnss.datum, out);
  put_datum(gnss.frame, out);
  out.put(static_cast<std::uint8_t>(gnss.altitude));
  out.put(static_cast<std::uint32_t>(gnss.positions.size()));
  for (const MeasuredPosition& position : gnss.positions) {
    out.put(static_cast<std::uint32_t>(position.node));
    for (const Vector3* const v : {&position.point, &position.position, &position.deviation}) {
      for (int i = 0; i < 3; ++i) out.put((*v)[i]);
    }
    out.put(static_cast<std::uint8_t>(position.is_inlier));
  }
}

bool get_gnss(ByteReader& in, MapGnss& gnss) {
  if (!get_datum(in, gnss.datum) || !get_datum(in, gnss.frame)) return false;
  gnss.altitude = static_cast<AltitudeReference>(in.get<std::uint8_t>());
  const auto count = in.get<std::uint32_t>();
  if (in.failed() || in.left() != count * kPositionBytes + 4 || gnss.altitude > AltitudeReference::kNone)
    return false;
  for (std::uint32_t i = 0; i < count; ++i) {
    MeasuredPosition position;
    position.node = in.get<std::uint32_t>();
    for (Vector3* const v : {&position.point, &position.position, &position.deviation}) {
      for (int axis = 0; axis < 3; ++axis) (*v)[axis] = in.get<double>();
    }
    position.is_inlier = in.get<std::uint8_t>() != 0;
    const bool is_possible = position.point.norm() < 1e4 && position.position.norm() < 1e7 &&
                             position.deviation.minCoeff() > 1e-3 &&
                             position.deviation.head<2>().allFinite() &&
                             (i == 0 || position.node > gnss.positions.back().node);
    if (!is_possible) return false;
    gnss.positions.push_back(position);
  }
  return true;
}

}  // namespace

MapCorrection correction_of(const LoopCloser& closer) {
  MapCorrection correction{closer.poses(), {}, {}};
  for (const Loop& loop : closer.loops()) {
    if (loop.is_verified()) correction.loops.push_back(loop);
  }
  return correction;
}

Bytes encode_correction(const MapCorrection& correction, const MapId& map) {
  ByteWriter out;
  out.put(kMagic);
  out.put(correction.gnss ? kGnssVersion : kVersion);
  out.put_bytes(map);
  out.put(static_cast<std::uint32_t>(correction.poses.size()));
  out.put(static_cast<std::uint32_t>(correction.loops.size()));
  for (const auto& [id, pose] : correction.poses) {
    out.put(id);
    put_pose(pose, out);
  }
  for (const Loop& loop : correction.loops) put_loop(loop, out);
  if (correction.gnss) put_gnss(*correction.gnss, out);
  out.put(crc32c(out.bytes()));
  return out.take();
}

Result<MapCorrection> decode_correction(std::span<const std::uint8_t> bytes, const MapId& map,
                                        const std::string& name) {
  const Error damaged{name + ": damaged - nilio map close writes it again"};
  ByteReader in(bytes);
  if (in.get<std::uint64_t>() != kMagic) return damaged;
  const auto version = in.get<std::uint16_t>();
  if (version != kVersion && version != kGnssVersion)
    return Error{name + ": format " + std::to_string(version) + ", this program reads " +
                 std::to_string(kGnssVersion) + " - use a newer nilio, or nilio map close"};
  const auto id = in.get_bytes(map.size());
  const auto poses = in.get<std::uint32_t>();
  const auto loops = in.get<std::uint32_t>();
  const std::size_t listed = poses * kPoseBytes + loops * kLoopBytes + 4;
  if (in.failed() || (version == kVersion ? in.left() != listed : in.left() <= listed)) return damaged;
  ByteReader end(bytes.last(4));
  if (end.get<std::uint32_t>() != crc32c(bytes.first(bytes.size() - 4))) return damaged;
  if (!std::equal(id.begin(), id.end(), map.begin()))
    return Error{name + ": belongs to another map - nilio map close writes it again"};
  MapCorrection correction;
  for (std::uint32_t i = 0; i < poses; ++i) {
    const auto submap = in.get<std::uint32_t>();
    const SE3 pose = get_pose(in);
    if (!is_valid_pose(pose) || (i > 0 && submap <= correction.poses.back().first)) return damaged;
    correction.poses.emplace_back(submap, pose);
  }
  for (std::uint32_t i = 0; i < loops; ++i) {
    Loop loop;
    if (!get_loop(in, loop)) return damaged;
    correction.loops.push_back(loop);
  }
  if (version == kGnssVersion && !get_gnss(in, correction.gnss.emplace())) return damaged;
  return correction;
}

}  // namespace nilio::mapping
