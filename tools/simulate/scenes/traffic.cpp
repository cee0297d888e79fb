#include "tools/simulate/scenes/traffic.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

/// Length of an oncoming car's path before and after the point of encounter.
constexpr double kOncomingReachM = 200.0;

/// Path of points a metre apart, and the distance along it at which the car meets the vehicle.
struct MeetingPath {
  std::vector<Vector3> places;
  double meeting_m = 0.0;
};

/// Extends a path towards `end` in steps of one metre; a shorter rest is left for the next call.
void extend_to(std::vector<Vector3>& places, const Vector2& end, const Ground& ground) {
  if (places.empty()) places.push_back(ground.on_ground(end));
  Vector2 rest = end - places.back().head<2>();
  while (rest.norm() >= 1.0) {
    places.push_back(ground.on_ground(places.back().head<2>() + rest.normalized()));
    rest = end - places.back().head<2>();
  }
}

/// Path in the oncoming lane around a sample, against the driving direction.
MeetingPath oncoming_path(const StreetLayout& layout, std::size_t meeting, const Ground& ground) {
  const std::vector<StreetSample>& samples = layout.samples();
  const auto reach = static_cast<std::size_t>(kOncomingReachM / kSampleSpacingM);
  const std::size_t last = meeting > reach ? meeting - reach : 0;
  MeetingPath path;
  for (std::size_t i = std::min(meeting + reach, samples.size() - 1) + 1; i-- > last;) {
    if (i == meeting) path.meeting_m = static_cast<double>(path.places.size());
    extend_to(path.places, samples[i].beside(kOncomingLaneM), ground);
  }
  return path;
}

/// The right-hand lane of a side street; `way` +1 crosses from right to left.
MeetingPath crossing_path(const StreetLayout& layout, const SideStreet& street, double way,
                          const Ground& ground) {
  const StreetSample& sample = layout.samples()[street.sample];
  const Vector2 along = direction(sample.yaw_rad);
  const Vector2 across = way * left_of(along);
  MeetingPath path;
  path.meeting_m = street.reach_m;
  for (double d = -street.reach_m; d <= street.reach_m; d += 1.0) {
    path.places.push_back(ground.on_ground(sample.position + d * across + way * 1.75 * along));
  }
  return path;
}

constexpr double kTrackStepS = 0.1;

/// Poses at the times first * kTrackStepS, (first + 1) * kTrackStepS...
struct Track {
  std::size_t first = 0;
  std::vector<SE3> poses;
};

Track make_track(const MovingCar& car, double duration_s) {
  const double begin_s = std::max(0.0, -car.start_m / car.speed_m_s);
  const double end_s =
      std::min(duration_s, (static_cast<double>(car.path.size()) - car.start_m) / car.speed_m_s);
  Track track;
  track.first = static_cast<std::size_t>(std::ceil(begin_s / kTrackStepS));
  for (std::size_t i = track.first; static_cast<double>(i) * kTrackStepS <= end_s; ++i) {
    const std::optional<SE3> pose = car.pose(static_cast<double>(i) * kTrackStepS);
    if (!pose) break;
    track.poses.push_back(*pose);
  }
  return track;
}

Track make_track(const VehicleTrajectory& trajectory) {
  Track track;
  for (std::size_t i = 0; static_cast<double>(i) * kTrackStepS <= trajectory.duration_s(); ++i) {
    track.poses.push_back(trajectory.pose(static_cast<double>(i) * kTrackStepS));
  }
  return track;
}

/// Whether `b` stays outside the rectangle around `a` of 2 * ahead_m by 2 * beside_m.
bool keep_clear(const Track& a, const Track& b, double ahead_m, double beside_m) {
  const double reach = ahead_m + beside_m;
  const std::size_t begin = std::max(a.first, b.first);
  const std::size_t end = std::min(a.first + a.poses.size(), b.first + b.poses.size());
  for (std::size_t i = begin; i < end; ++i) {
    const SE3& pose_a = a.poses[i - a.first];
    const SE3& pose_b = b.poses[i - b.first];
    if ((pose_a.translation - pose_b.translation).squaredNorm() > reach * reach) continue;
    const Vector3 seen = pose_a.inverse() * pose_b.translation;
    if (std::abs(seen.x()) < ahead_m && std::abs(seen.y()) < beside_m) return false;
  }
  return true;
}

/// A car that meets the vehicle in the oncoming lane or at a side street.
MovingCar random_car(const StreetLayout& layout, const Ground& ground, RandomStream& random) {
  MovingCar car;
  car.model = random.index(kCarModels);
  car.speed_m_s = random.uniform(6.0, 12.0);
  const std::vector<StreetSample>& samples = layout.samples();
  MeetingPath path;
  double meeting_s = 0.0;
  if (!layout.side_streets().empty() && random.chance(0.35)) {
    const SideStreet& street = layout.side_streets()[random.index(layout.side_streets().size())];
    path = crossing_path(layout, street, random.chance(0.5) ? 1.0 : -1.0, ground);
    const double before_or_after = random.chance(0.5) ? random.uniform(-6.0, -1.5) : random.uniform(1.5, 5.0);
    meeting_s = samples[street.sample].time_s + before_or_after;
  } else {
    const std::size_t meeting = random.index(samples.size());
    path = oncoming_path(layout, meeting, ground);
    meeting_s = samples[meeting].time_s;
  }
  car.path = std::move(path.places);
  car.start_m = path.meeting_m - car.speed_m_s * meeting_s;
  return car;
}

}  // namespace

double MovingCar::travelled_m(double time_s) const {
  const double travelled = start_m + speed_m_s * time_s;
  if (halt_s <= 0.0) return travelled;
  const double braking_s = speed_m_s / kHaltAcceleration;
  const double braking_m = 0.5 * speed_m_s * braking_s;
  const double after_s = time_s - (halt_m - braking_m - start_m) / speed_m_s;
  if (after_s <= 0.0) return travelled;
  const double left_s = std::max(0.0, braking_s - after_s);
  if (after_s <= braking_s + halt_s) return halt_m - 0.5 * kHaltAcceleration * left_s * left_s;
  const double off_s = after_s - braking_s - halt_s;
  if (off_s <= braking_s) return halt_m + 0.5 * kHaltAcceleration * off_s * off_s;
  return halt_m + braking_m + speed_m_s * (off_s - braking_s);
}

std::optional<SE3> MovingCar::pose(double time_s) const {
  const double travelled = travelled_m(time_s);
  if (!(travelled >= 0.0) || travelled >= static_cast<double>(path.size()) - 1.0) return std::nullopt;
  const auto index = static_cast<std::size_t>(travelled);
  const Vector3& a = path[index];
  const Vector3& b = path[index + 1];
  // Heading over a car's length, since the path is a polyline.
  const Vector3 chord = path[std::min(index + 3, path.size() - 1)] - path[index < 2 ? 0 : index - 2];
  const double yaw = std::atan2(chord.y(), chord.x());
  const double pitch = -std::atan2(chord.z(), chord.head<2>().norm());
  SE3 pose;
  pose.rotation = Eigen::AngleAxisd(yaw, Vector3::UnitZ()) * Eigen::AngleAxisd(pitch, Vector3::UnitY());
  pose.translation = a + (travelled - static_cast<double>(index)) * (b - a);
  return pose;
}

std::vector<MovingCar> make_traffic(const VehicleTrajectory& trajectory, const StreetLayout& layout,
                                    const Ground& ground, std::size_t count, std::uint64_t seed) {
  RandomStream random(seed, 41);
  const Track vehicle = make_track(trajectory);
  std::vector<MovingCar> cars;
  std::vector<Track> tracks;
  const std::size_t tries = 4 * count;
  for (std::size_t i = 0; i < tries && cars.size() < count; ++i) {
    MovingCar car = random_car(layout, ground, random);
    Track track = make_track(car, trajectory.duration_s());
    const bool clear = keep_clear(vehicle, track, 7.0, 2.4) &&
                       std::all_of(tracks.begin(), tracks.end(),
                                   [&](const Track& other) { return keep_clear(track, other, 7.0, 2.2); });
    if (!clear) continue;
    cars.push_back(std::move(car));
    tracks.push_back(std::move(track));
  }
  return cars;
}

}  // namespace nilio::tools::simulate
