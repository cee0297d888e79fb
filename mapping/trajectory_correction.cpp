#include "mapping/trajectory_correction.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "mapping/loops/place.hpp"
#include "mapping/record_log.hpp"

namespace nilio::mapping {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using core::SE3;

/// Pose of a place before and after loop closure.
struct PlaceCorrection {
  core::Time stamp;
  SE3 T_place_odom;
  SE3 T_map_place;

  [[nodiscard]] SE3 operator()(const SE3& T_odom_base) const {
    return T_map_place * (T_place_odom * T_odom_base);
  }
};

struct StampedPose {
  core::Time stamp;
  SE3 T_odom_base;
};

std::optional<StampedPose> parse_line(const std::string& line) {
  StampedPose pose;
  long long seconds = 0;
  // Stamps of this century do not fit into a double.
  std::array<char, 10> nanoseconds{};
  auto& q = pose.T_odom_base.rotation.coeffs();
  auto& t = pose.T_odom_base.translation;
  if (std::sscanf(line.c_str(), "%lld.%9[0-9] %lf %lf %lf %lf %lf %lf %lf", &seconds, nanoseconds.data(),
                  &t.x(), &t.y(), &t.z(), &q.x(), &q.y(), &q.z(), &q.w()) != 9)
    return std::nullopt;
  std::string digits(nanoseconds.data());
  digits.resize(9, '0');
  constexpr long long kMaxSeconds = 9'000'000'000;
  if (std::llabs(seconds) > kMaxSeconds || !pose.T_odom_base.is_finite() || std::abs(q.norm() - 1.0) > 1e-3)
    return std::nullopt;
  pose.stamp.ns = seconds * 1'000'000'000 + std::strtoll(digits.c_str(), nullptr, 10);
  pose.T_odom_base.rotation.normalize();
  return pose;
}

Result<std::vector<PlaceCorrection>> corrections_of(const MapReader& map) {
  std::vector<PlaceCorrection> corrections;
  for (const SubmapEntry& entry : map.submaps()) {
    const auto submap = map.load(entry);
    if (!submap) return submap.error();
    if (submap->keyframes.empty()) continue;
    const SE3 T = place_origin(*submap);
    corrections.push_back({submap->keyframes[submap->keyframes.size() / 2].stamp,
                           (entry.T_odom_submap * T).inverse(), entry.T_map_submap * T});
  }
  return corrections;
}

SE3 corrected(const StampedPose& pose, const std::vector<PlaceCorrection>& corrections) {
  if (corrections.empty()) return pose.T_odom_base;
  const auto after = std::upper_bound(
      corrections.begin(), corrections.end(), pose.stamp,
      [](core::Time wanted, const PlaceCorrection& correction) { return wanted < correction.stamp; });
  if (after == corrections.begin()) return (*after)(pose.T_odom_base);
  const PlaceCorrection& before = *(after - 1);
  const SE3 a = before(pose.T_odom_base);
  if (after == corrections.end()) return a;
  const SE3 b = (*after)(pose.T_odom_base);
  const double share = (pose.stamp - before.stamp).seconds() / (after->stamp - before.stamp).seconds();
  const core::Vector3 turn = core::so3_log(a.rotation.conjugate() * b.rotation);
  return {(a.rotation * core::so3_exp(share * turn)).normalized(),
          (1.0 - share) * a.translation + share * b.translation};
}

/// Reads a file of poses; `read(pose, line)` gets each.
template <class Read>
Result<std::size_t> for_each_pose(const fs::path& path, const std::string& advice, const Read& read) {
  std::ifstream file(path);
  if (!file) return Error{path.string() + ": cannot be opened - check the path"};
  std::size_t poses = 0;
  for (std::string line; std::getline(file, line); ++poses) {
    const auto pose = parse_line(line);
    if (!pose)
      return Error{path.string() + ":" + std::to_string(poses + 1) +
                   ": not a pose as niliod writes it - use " + advice};
    read(*pose, line);
  }
  return poses;
}

/// Appends a pose with the stamp of the line it comes from.
void append(const std::string& line, const SE3& T, std::string& text) {
  const Eigen::Quaterniond& q = T.rotation;
  std::array<char, 320> numbers{};
  std::snprintf(numbers.data(), numbers.size(), " %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
                T.translation.x(), T.translation.y(), T.translation.z(), q.x(), q.y(), q.z(), q.w());
  text += line.substr(0, line.find(' ')) + numbers.data();
}

core::Result<std::monostate> write_text(const fs::path& path, const std::string& text) {
  return replace_file(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
}

constexpr const char* kTrajectoryAdvice = "the trajectory.tum of the run";

}  // namespace

Result<std::size_t> correct_trajectory(const MapReader& map, const fs::path& trajectory,
                                       const fs::path& output) {
  const auto corrections = corrections_of(map);
  if (!corrections) return corrections.error();
  std::string text;
  const auto poses =
      for_each_pose(trajectory, kTrajectoryAdvice, [&](const StampedPose& pose, const std::string& line) {
        append(line, corrected(pose, *corrections), text);
      });
  if (!poses) return poses;
  if (auto written = write_text(output, text); !written) return written.error();
  return poses;
}

Result<std::size_t> localise_trajectory(const fs::path& localisation, const fs::path& trajectory,
                                        const fs::path& output) {
  // Their T_odom_base is T_map_odom.
  std::vector<StampedPose> transforms;
  const auto read =
      for_each_pose(localisation, "the localisation.txt of the run",
                    [&](const StampedPose& pose, const std::string&) { transforms.push_back(pose); });
  if (!read) return read;
  std::string text;
  std::size_t localised = 0;
  const auto poses =
      for_each_pose(trajectory, kTrajectoryAdvice, [&](const StampedPose& pose, const std::string& line) {
        const auto after = std::upper_bound(
            transforms.begin(), transforms.end(), pose.stamp,
            [](core::Time wanted, const StampedPose& transform) { return wanted < transform.stamp; });
        if (after == transforms.begin()) return;
        append(line, (after - 1)->T_odom_base * pose.T_odom_base, text);
        ++localised;
      });
  if (!poses) return poses;
  if (auto written = write_text(output, text); !written) return written.error();
  return localised;
}

}  // namespace nilio::mapping
