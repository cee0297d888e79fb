#include "tools/map/close.hpp"

#include "nilio/core/clock.hpp"

#include "tools/map/cloud.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <map>
#include <optional>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::map {

namespace {

using core::Result;
using core::SE3;
using mapping::MapReader;
using mapping::Submap;

struct Middle {
  core::Time stamp;
  SE3 T_place_base;
};

std::vector<double> pose_numbers(const SE3& T) {
  const auto& q = T.rotation;
  return {T.translation.x(), T.translation.y(), T.translation.z(), q.x(), q.y(), q.z(), q.w()};
}

/// Keyframes of a submap, and its place.
struct PlacedKeyframes {
  SE3 T_submap_place;
  std::vector<mapping::SubmapKeyframe> keyframes;
};

/// Moves the submaps of `closer` by GNSS.
Result<std::monostate> add_positions(const std::optional<GnssInput>& input,
                                     const std::vector<PlacedKeyframes>& submaps, const std::string& name,
                                     mapping::LoopCloser& closer, ClosedMap& closed) {
  if (input) {
    Trajectory path;
    path.path = name;
    std::vector<MapPlace> places;
    const auto poses = closer.poses();
    for (std::size_t i = 0; i < submaps.size(); ++i) {
      add_path(submaps[i].keyframes, poses[i].second, path);
      places.push_back({poses[i].first, closed.stamps[i], poses[i].second * submaps[i].T_submap_place});
    }
    auto matched = match_positions(path, places, *input);
    if (!matched) return matched.error();
    closed.gnss = std::move(matched).value();
  }
  if (!closed.gnss || closed.gnss->positions.empty()) return std::monostate{};
  closer.set_positions(closed.gnss->positions);
  closed.gnss->positions = closer.positions();
  closed.gnss->datum = datum_of(*closed.gnss, closer.T_measured_map());
  const auto poses = closer.poses();
  double squares = 0.0;
  std::size_t inliers = 0;
  for (const mapping::MeasuredPosition& position : closer.positions()) {
    if (!position.is_inlier) continue;
    const auto at = std::find(closed.ids.begin(), closed.ids.end(), position.node) - closed.ids.begin();
    const auto i = static_cast<std::size_t>(at);
    const auto error = mapping::position_error(position, poses[i].second * submaps[i].T_submap_place,
                                               closer.T_measured_map());
    squares += error.error.cwiseProduct(position.deviation).head<2>().squaredNorm();
    ++inliers;
  }
  if (2 * inliers < closer.positions().size())
    return core::Error{name + ": " + std::to_string(inliers) + " of " +
                       std::to_string(closer.positions().size()) +
                       " positions of GNSS agree with the map - check that they are of this drive, and "
                       "--antenna and --time-offset"};
  closed.gnss_rms_m = std::sqrt(squares / static_cast<double>(std::max<std::size_t>(inliers, 1)));
  return std::monostate{};
}

}  // namespace

Result<ClosedMap> close(const std::filesystem::path& folder, const std::optional<GnssInput>& gnss) {
  const auto map = MapReader::open(folder);
  if (!map) return map.error();
  auto writer = mapping::MapWriter::open(folder, map->header().session, {clock_ns(CLOCK_REALTIME)});
  if (!writer) return writer.error();
  const MapReader& content = writer->content();
  mapping::LoopCloser closer([&](std::uint32_t id) -> std::optional<Submap> {
    const auto& entries = content.submaps();
    const auto entry =
        std::find_if(entries.begin(), entries.end(), [&](const auto& e) { return e.id == id; });
    auto submap = entry == entries.end() ? Result<Submap>(core::Error{""}) : content.load(*entry);
    return submap ? std::optional(std::move(submap).value()) : std::nullopt;
  });
  std::map<std::uint32_t, Middle> middles;
  ClosedMap closed;
  const auto timed = [&](const auto& work) {
    const std::int64_t begin = monotonic_ns();
    work();
    const double seconds = static_cast<double>(monotonic_ns() - begin) * 1e-9;
    closed.seconds += seconds;
    closed.longest_submap_s = std::max(closed.longest_submap_s, seconds);
  };
  std::vector<SE3> odometry;
  std::vector<PlacedKeyframes> submaps;
  for (const mapping::SubmapEntry& entry : content.submaps()) {
    const auto submap = content.load(entry);
    if (!submap) return submap.error();
    timed([&] { closer.add(*submap); });
    odometry.push_back(submap->T_odom_submap);
    submaps.push_back({place_origin(*submap), submap->keyframes});
    closed.ids.push_back(entry.id);
    closed.stamps.push_back(entry.first_stamp);
    if (submap->keyframes.empty()) continue;
    const mapping::SubmapKeyframe& middle = submap->keyframes[submap->keyframes.size() / 2];
    closed.stamps.back() = middle.stamp;
    middles[entry.id] = {middle.stamp, place_origin(*submap).inverse() * middle.T_submap_base};
  }
  timed([&] { closer.finish(); });
  closed.gnss = content.gnss();
  if (auto added = add_positions(gnss, submaps, folder.string(), closer, closed); !added)
    return added.error();
  for (const mapping::OdometryEdge& edge : closer.edges())
    closed.deviations.push_back(walk_variance(edge).cwiseSqrt());
  mapping::MapCorrection correction = mapping::correction_of(closer);
  correction.gnss = closed.gnss;
  for (std::size_t i = 0; i < odometry.size(); ++i)
    closed.largest_correction_m =
        std::max(closed.largest_correction_m,
                 (correction.poses[i].second.translation - odometry[i].translation).norm());
  for (const mapping::Loop& loop : closer.loops()) {
    const Middle& reference = middles[loop.reference];
    const Middle& moving = middles[loop.moving];
    closed.loops.push_back(
        {loop, reference.stamp, moving.stamp,
         reference.T_place_base.inverse() * loop.alignment.T_reference_moving * moving.T_place_base});
  }
  if (auto written = writer->write(correction); !written) return written.error();
  return closed;
}

std::string loops_json(const ClosedMap& map) {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const ClosedLoop& closed : map.loops) {
    const mapping::Loop& loop = closed.loop;
    std::vector<double> information;
    for (int i = 0; i < 36; ++i) information.push_back(loop.alignment.information(i / 6, i % 6));
    list.push_back({{"reference", loop.reference},
                    {"moving", loop.moving},
                    {"verdict", mapping::verdict_name(loop.verdict)},
                    {"reference_stamp_ns", closed.reference_stamp.ns},
                    {"moving_stamp_ns", closed.moving_stamp.ns},
                    {"T_reference_moving", pose_numbers(closed.T_reference_moving)},
                    {"information", information},
                    {"inliers", loop.inliers},
                    {"compared", loop.alignment.compared},
                    {"overlap", loop.alignment.overlap},
                    {"support", loop.alignment.support},
                    {"support_share", loop.support_share},
                    {"contradiction", loop.alignment.contradiction},
                    {"ambiguity", loop.ambiguity},
                    {"drift_square", loop.drift_square}});
  }
  std::vector<std::int64_t> stamps;
  for (const core::Time stamp : map.stamps) stamps.push_back(stamp.ns);
  std::vector<std::vector<double>> deviations;
  for (const core::Vector6& d : map.deviations) deviations.emplace_back(d.data(), d.data() + d.size());
  return nlohmann::ordered_json{{"submaps", map.ids.size()}, {"ids", map.ids},
                                {"stamps_ns", stamps},       {"edge_deviations", deviations},
                                {"seconds", map.seconds},    {"loops", list}}
             .dump(1) +
         "\n";
}

}  // namespace nilio::tools::map
