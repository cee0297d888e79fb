#include "tools/common/files.hpp"
#include "tools/convert/kitti_raw.hpp"
#include "tools/convert/kitti_raw_encoder.hpp"
#include "tools/mangle/mangle.hpp"
#include "tools/mangle/return_faults.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <system_error>

namespace nilio::tools::mangle {

namespace {

namespace fs = std::filesystem;
using convert::KittiPoint;
using core::Error;
using core::Result;

constexpr unsigned kRings = 64;
// Poses of a sequence, one line a scan, under the names that nilio's tools use.
constexpr std::array kPoseFiles{"poses.txt", "truth.txt"};

Result<std::vector<std::string>> read_lines(const fs::path& path) {
  std::ifstream file(path);
  if (!file) return Error{path.string() + ": cannot be read: a KITTI sequence needs it"};
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

Result<std::monostate> write_lines(const fs::path& path, const std::vector<std::string>& lines) {
  std::ofstream file(path);
  for (const std::string& line : lines) file << line << '\n';
  if (file.flush()) return std::monostate{};
  return cannot_write(path);
}

std::vector<Return> to_returns(const std::vector<KittiPoint>& points) {
  std::vector<Return> returns;
  returns.reserve(points.size());
  const std::vector<std::uint16_t> from_top = convert::kitti_rings(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const KittiPoint& p = points[i];
    returns.push_back({{p.x, p.y, p.z}, kRings - 1 - std::min<unsigned>(from_top[i], kRings - 1)});
  }
  return returns;
}

std::vector<KittiPoint> edited(const std::vector<KittiPoint>& points,
                               const std::vector<EditedReturn>& edits) {
  std::vector<KittiPoint> result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (edits[i].range_m <= 0.0F) continue;
    KittiPoint p = points[i];
    const float range = std::sqrt(p.x * p.x + p.y * p.y + p.z * p.z);
    if (range > 0.0F && range != edits[i].range_m) {
      const float factor = edits[i].range_m / range;
      p.x *= factor;
      p.y *= factor;
      p.z *= factor;
    }
    result.push_back(p);
  }
  return result;
}

/// Scans of the new sequence: index in the old one and new time.
struct Kept {
  std::size_t index = 0;
  std::string time;
};

bool is_in_gap(const Faults& faults, double seconds) {
  return std::any_of(faults.gaps.begin(), faults.gaps.end(), [&](const TimedFault& gap) {
    return seconds >= gap.at_s && seconds < gap.at_s + gap.amount_s;
  });
}

std::string format_time(double seconds) {
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.9f", seconds);
  return text.data();
}

Result<std::vector<double>> parse_times(const fs::path& path, const std::vector<std::string>& lines,
                                        std::size_t scans) {
  if (lines.size() < scans)
    return Error{path.string() + ": has " + std::to_string(lines.size()) + " times for " +
                 std::to_string(scans) + " scans"};
  std::vector<double> times;
  for (std::size_t i = 0; i < scans; ++i) {
    const auto numbers = parse_numbers(lines[i]);
    if (!numbers || numbers->size() != 1)
      return Error{line_error(path.string(), i + 1, "not a time in seconds")};
    times.push_back(numbers->front());
  }
  return times;
}

Result<std::vector<Kept>> select_scans(const Faults& faults, const std::vector<std::string>& lines,
                                       const std::vector<double>& times) {
  std::vector<Kept> kept;
  for (const TimedFault& gap : faults.gaps) {
    const Faults alone{.burst = {}, .clock_steps = {}, .gaps = {gap}};
    const bool hits = std::any_of(times.begin(), times.end(),
                                  [&](double t) { return is_in_gap(alone, t - times.front()); });
    if (!hits)
      return Error{"--gap " + std::to_string(gap.amount_s) + "@" + std::to_string(gap.at_s) +
                   ": no scan is in it, the sequence has " + std::to_string(times.back() - times.front()) +
                   " s"};
  }
  for (std::size_t i = 0; i < times.size(); ++i) {
    const bool dropped = faults.drop_scans > 0 && (i + 1) % faults.drop_scans == 0;
    if (!dropped && !is_in_gap(faults, times[i] - times.front())) kept.push_back({i, lines[i]});
  }
  if (kept.size() < 2) return Error{"fewer than two scans would remain - give a shorter gap"};
  if (!faults.reverse) return kept;
  std::reverse(kept.begin(), kept.end());
  for (Kept& scan : kept) scan.time = format_time(times.front() + times.back() - times[scan.index]);
  return kept;
}

Result<std::vector<fs::path>> list_scans(const fs::path& sequence) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(sequence / "velodyne", error)) {
    if (entry.path().extension() == ".bin") files.push_back(entry.path());
  }
  if (error || files.empty()) return Error{sequence.string() + "/velodyne: no scans (*.bin)"};
  std::sort(files.begin(), files.end());
  return files;
}

Result<std::monostate> write_scan(const fs::path& path, const std::vector<KittiPoint>& points) {
  std::ofstream file(path, std::ios::binary);
  file.write(reinterpret_cast<const char*>(points.data()),
             static_cast<std::streamsize>(points.size() * sizeof(KittiPoint)));
  if (file.flush()) return std::monostate{};
  return cannot_write(path);
}

Result<std::monostate> write_scans(const std::vector<fs::path>& files, const std::vector<Kept>& kept,
                                   const Options& options, Summary& summary) {
  ReturnFaults faults(options.faults, kRings);
  std::vector<EditedReturn> edits;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    auto points = convert::read_kitti_scan(files[kept[k].index]);
    if (!points) return points.error();
    if (options.faults.changes_returns()) {
      faults.apply(to_returns(*points), kept[k].index, edits);
      points = edited(*points, edits);
    }
    std::array<char, 32> name{};
    std::snprintf(name.data(), name.size(), "%06zu.bin", k);
    if (auto written = write_scan(fs::path(options.output) / "velodyne" / name.data(), *points); !written)
      return written;
  }
  summary.returns = faults.counts();
  return std::monostate{};
}

Result<std::monostate> write_poses(const fs::path& sequence, const std::vector<Kept>& kept,
                                   const fs::path& output) {
  for (const char* name : kPoseFiles) {
    if (!fs::exists(sequence / name)) continue;
    const auto poses = read_lines(sequence / name);
    if (!poses) return poses.error();
    std::vector<std::string> lines;
    for (const Kept& scan : kept) {
      if (scan.index >= poses->size())
        return Error{(sequence / name).string() + ": has " + std::to_string(poses->size()) +
                     " poses, fewer than there are scans"};
      lines.push_back((*poses)[scan.index]);
    }
    if (auto written = write_lines(output / name, lines); !written) return written;
  }
  return std::monostate{};
}

/// truth.tum, which has its own times: as it is, or in the reverse order.
Result<std::monostate> write_truth(const fs::path& path, bool reversed, const std::vector<double>& times,
                                   const fs::path& output) {
  if (!fs::exists(path)) return std::monostate{};
  auto truth = read_trajectory(path.string());
  if (!truth) return truth.error();
  if (reversed) {
    const core::Time sum{core::Time::from_seconds(times.front()).ns +
                         core::Time::from_seconds(times.back()).ns};
    std::reverse(truth->poses.begin(), truth->poses.end());
    std::reverse(truth->stamps.begin(), truth->stamps.end());
    for (core::Time& stamp : truth->stamps) stamp = core::Time{sum.ns - stamp.ns};
  }
  const auto written = write_trajectory(*truth, (output / "truth.tum").string());
  if (!written) return written.error();
  return std::monostate{};
}

}  // namespace

Result<Summary> mangle_kitti(const fs::path& sequence, const Options& options) {
  if (options.faults.changes_packets())
    return Error{options.input +
                 ": is a KITTI sequence, which has scans but no packets - --loss, --burst, --duplicate, "
                 "--reorder and --clock-step need a capture"};
  if (options.faults.rings >= kRings)
    return Error{"--rings " + std::to_string(options.faults.rings) + ": the sensor has 64 - give fewer"};
  const auto files = list_scans(sequence);
  if (!files) return files.error();
  const fs::path times_path = sequence / "times.txt";
  const auto lines = read_lines(times_path);
  if (!lines) return lines.error();
  const auto times = parse_times(times_path, *lines, files->size());
  if (!times) return times.error();
  const auto kept = select_scans(options.faults, *lines, *times);
  if (!kept) return kept.error();
  const fs::path output(options.output);
  std::error_code error;
  fs::create_directories(output / "velodyne", error);
  fs::copy_file(sequence / "calib.txt", output / "calib.txt", error);
  if (error) return Error{(sequence / "calib.txt").string() + ": cannot be copied (" + error.message() + ")"};
  Summary summary;
  summary.scans = files->size();
  summary.scans_dropped = files->size() - kept->size();
  std::vector<std::string> new_times;
  for (const Kept& scan : *kept) new_times.push_back(scan.time);
  if (auto written = write_lines(output / "times.txt", new_times); !written) return written.error();
  if (auto written = write_poses(sequence, *kept, output); !written) return written.error();
  if (auto written = write_truth(sequence / "truth.tum", options.faults.reverse, *times, output); !written)
    return written.error();
  if (auto written = write_scans(*files, *kept, options, summary); !written) return written.error();
  return summary;
}

}  // namespace nilio::tools::mangle
