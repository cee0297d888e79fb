#include "tools/gnss/track.hpp"

#include "nilio/drivers/bag/sources.hpp"
#include "nilio/drivers/capture/file_kind.hpp"

#include "tools/common/statistics.hpp"
#include "tools/common/text.hpp"

#include <cmath>
#include <map>
#include <utility>

namespace nilio::tools::gnss {

namespace {

using core::Error;
using core::Result;

/// Leaves out positions whose stamps do not increase; an error if none is left.
Result<Track> check(Result<Track> track) {
  if (!track) return track;
  std::vector<Fix> kept;
  kept.reserve(track->fixes.size());
  for (Fix& fix : track->fixes) {
    if (kept.empty() || fix.stamp > kept.back().stamp)
      kept.push_back(std::move(fix));
    else
      ++track->left_out;
  }
  track->fixes = std::move(kept);
  if (track->fixes.empty())
    return Error{track->name + ": no position (" + std::to_string(track->without_fix) +
                 " messages without a fix, " + std::to_string(track->left_out) +
                 " damaged) - check antenna and receiver"};
  return track;
}

}  // namespace

std::optional<double> Fix::horizontal_deviation_m() const {
  if (!deviation_m) return std::nullopt;
  return std::sqrt(((*deviation_m)[0] * (*deviation_m)[0] + (*deviation_m)[1] * (*deviation_m)[1]) / 2.0);
}

bool may_hold_track(const std::string& path) {
  return drivers::is_bag(path) || drivers::file_kind(path) == drivers::FileKind::kCapture ||
         is_csv_track(path);
}

Result<Track> read_track(const std::string& path, const std::string& topic) {
  if (drivers::is_bag(path)) {
    const auto files = drivers::bag_files(path);
    return files ? read_bag_track(*files, topic) : Result<Track>(files.error());
  }
  if (!topic.empty()) return Error{"--topic: " + path + " is no ROS bag - leave it out"};
  if (drivers::file_kind(path) == drivers::FileKind::kCapture) return check(read_capture(path));
  return check(read_csv(path));
}

Result<Track> read_bag_track(const std::vector<std::string>& files, const std::string& topic) {
  return check(read_bag(files, topic));
}

GeodeticFrame frame_at(const Fix& fix) {
  return GeodeticFrame({fix.latitude_deg, fix.longitude_deg, fix.altitude_m.value_or(0.0), 90.0});
}

Eigen::Vector3d local(const GeodeticFrame& frame, const Fix& fix) {
  return frame.local(fix.latitude_deg, fix.longitude_deg, fix.altitude_m.value_or(0.0));
}

std::optional<double> median_deviation_m(const Track& track) {
  std::vector<double> deviations;
  for (const Fix& fix : track.fixes) {
    if (const auto deviation = fix.horizontal_deviation_m()) deviations.push_back(*deviation);
  }
  if (deviations.empty()) return std::nullopt;
  return median(std::move(deviations));
}

double track_length_m(const Track& track) {
  const double noise = 3.0 * median_deviation_m(track).value_or(0.5 / 3.0);
  const GeodeticFrame frame = frame_at(track.fixes.front());
  double length = 0.0;
  Eigen::Vector3d last = local(frame, track.fixes.front());
  for (const Fix& fix : track.fixes) {
    const Eigen::Vector3d place = local(frame, fix);
    const double step = (place - last).head<2>().norm();
    if (step < noise) continue;
    length += step;
    last = place;
  }
  return length;
}

std::string csv_text(const Track& track) {
  std::string text =
      "stamp_s,latitude_deg,longitude_deg,altitude_m,std_east_m,std_north_m,std_up_m,quality,east_m,north_m,"
      "up_m\n";
  const GeodeticFrame frame = frame_at(track.fixes.front());
  const auto optional = [](bool is_there, double value) { return is_there ? format(",%.4f", value) : ","; };
  for (const Fix& fix : track.fixes) {
    text += stamp_text(fix.stamp) + format(",%.10f,%.10f", fix.latitude_deg, fix.longitude_deg);
    text += optional(fix.altitude_m.has_value(), fix.altitude_m.value_or(0.0));
    for (const double deviation : fix.deviation_m.value_or(std::array<double, 3>{}))
      text += optional(fix.deviation_m && std::isfinite(deviation), deviation);
    const Eigen::Vector3d place = local(frame, fix);
    text += "," + fix.quality + format(",%.4f,%.4f", place.x(), place.y());
    text += optional(fix.altitude_m.has_value(), place.z()) + "\n";
  }
  return text;
}

std::string summary(const Track& track) {
  std::map<std::string, std::size_t> qualities;
  for (const Fix& fix : track.fixes) ++qualities[fix.quality];
  std::string list;
  for (const auto& [quality, count] : qualities) {
    if (!quality.empty()) list += (list.empty() ? "" : ", ") + std::to_string(count) + " " + quality;
  }
  std::string text = format("%zu positions", track.fixes.size());
  if (!list.empty()) text += " (" + list + ")";
  if (track.without_fix > 0)
    text += format(", %llu messages without a fix", static_cast<unsigned long long>(track.without_fix));
  if (track.left_out > 0)
    text += format(", %llu damaged or out of order", static_cast<unsigned long long>(track.left_out));
  const auto deviation = median_deviation_m(track);
  text += deviation ? format("; horizontal standard deviation %.2f m (median, as stated)", *deviation)
                    : "; accuracy not stated";
  const Fix& first = track.fixes.front();
  return text + format("; %.0f m of path from %.6f, %.6f", track_length_m(track), first.latitude_deg,
                       first.longitude_deg);
}

}  // namespace nilio::tools::gnss
