#include "tools/convert/kitti_raw.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <numbers>
#include <utility>

namespace nilio::tools::convert {

namespace fs = std::filesystem;

namespace {

constexpr std::size_t kOxtsColumns = 30;
constexpr double kEarthRadiusM = 6378137.0;
// 1200 to 120 revolutions per minute; the scanner supports 300 to 1200.
constexpr core::Duration kMinRevolution{50'000'000};
constexpr core::Duration kMaxRevolution{500'000'000};

std::optional<std::int64_t> parse_integer(std::string_view text) {
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || text.front() == '-' || error != std::errc() || end != text.data() + text.size()) {
    return std::nullopt;
  }
  return value;
}

std::string_view trim(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r\n") - begin + 1);
}

/// Files of a folder named "<number><extension>", in order of the numbers.
core::Result<std::vector<std::pair<std::size_t, fs::path>>> list_numbered(const fs::path& folder,
                                                                          const std::string& extension) {
  std::vector<std::pair<std::size_t, fs::path>> files;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const auto number = parse_integer(entry.path().stem().string());
    if (number && entry.path().extension() == extension) {
      files.emplace_back(static_cast<std::size_t>(*number), entry.path());
    }
  }
  if (error || files.empty()) {
    return core::Error{folder.string() + ": no files like 0000000000" + extension +
                       "; give the folder of an unpacked KITTI raw drive (<date>_drive_<number>_sync)"};
  }
  std::sort(files.begin(), files.end());
  return files;
}

core::Result<std::vector<KittiRawScan>> read_scans(const fs::path& velodyne, std::size_t& without_stamp) {
  const auto files = list_numbered(velodyne / "data", ".bin");
  if (!files) return files.error();
  const auto starts = read_kitti_stamps(velodyne / "timestamps_start.txt");
  if (!starts) return starts.error();
  const auto ends = read_kitti_stamps(velodyne / "timestamps_end.txt");
  if (!ends) return ends.error();
  std::vector<KittiRawScan> scans;
  for (const auto& [frame, path] : *files) {
    const bool stamped = frame < starts->size() && frame < ends->size() && (*starts)[frame] && (*ends)[frame];
    const core::Duration revolution = stamped ? *(*ends)[frame] - *(*starts)[frame] : core::Duration{};
    const bool in_order = scans.empty() || (stamped && *(*starts)[frame] > scans.back().start);
    if (revolution < kMinRevolution || revolution > kMaxRevolution || !in_order) {
      ++without_stamp;
      continue;
    }
    scans.push_back({frame, path, *(*starts)[frame], *(*ends)[frame]});
  }
  if (scans.empty()) return core::Error{velodyne.string() + ": no scan has a usable start and end time"};
  return scans;
}

core::Result<OxtsRecord> read_oxts_record(const fs::path& path, core::Time stamp) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  const auto numbers = parse_numbers(line);
  if (!numbers || numbers->size() != kOxtsColumns) {
    return core::Error{path.string() + ":1: needs 30 finite numbers (see dataformat.txt of the drive)"};
  }
  const std::vector<double>& v = *numbers;
  if (std::abs(v[0]) > 89.0 || std::abs(v[1]) > 360.0) {
    return core::Error{path.string() + ":1: latitude or longitude out of range"};
  }
  OxtsRecord record;
  record.stamp = stamp;
  record.latitude_deg = v[0];
  record.longitude_deg = v[1];
  record.altitude_m = v[2];
  record.position_deviation_m = v[23];
  record.roll_pitch_yaw = {v[3], v[4], v[5]};
  record.linear_acceleration = {v[11], v[12], v[13]};
  record.angular_velocity = {v[17], v[18], v[19]};
  return record;
}

core::Result<std::vector<OxtsRecord>> read_oxts(const fs::path& folder) {
  const auto files = list_numbered(folder / "data", ".txt");
  if (!files) return files.error();
  const auto stamps = read_kitti_stamps(folder / "timestamps.txt");
  if (!stamps) return stamps.error();
  std::vector<OxtsRecord> records;
  for (const auto& [frame, path] : *files) {
    if (frame >= stamps->size() || !(*stamps)[frame]) continue;
    auto record = read_oxts_record(path, *(*stamps)[frame]);
    if (!record) return record.error();
    records.push_back(*record);
  }
  // The receiver of 2011 sometimes repeats a record or writes two in the wrong order.
  std::stable_sort(records.begin(), records.end(),
                   [](const auto& a, const auto& b) { return a.stamp < b.stamp; });
  const auto same = [](const auto& a, const auto& b) { return a.stamp == b.stamp; };
  records.erase(std::unique(records.begin(), records.end(), same), records.end());
  if (records.empty()) return core::Error{folder.string() + ": no record has a time"};
  return records;
}

core::Result<core::SE3> read_imu_to_lidar(const fs::path& path) {
  std::ifstream file(path);
  if (!file) {
    return core::Error{path.string() +
                       ": cannot be opened; unpack the calibration of the date (<date>_calib.zip) "
                       "beside the drive"};
  }
  std::vector<double> rotation;
  std::vector<double> translation;
  std::string line;
  while (std::getline(file, line)) {
    const auto numbers = line.size() > 2 ? parse_numbers(std::string_view(line).substr(2)) : std::nullopt;
    if (line.starts_with("R:") && numbers) rotation = *numbers;
    if (line.starts_with("T:") && numbers) translation = *numbers;
  }
  if (rotation.size() != 9 || translation.size() != 3) {
    return core::Error{path.string() + ": needs a line \"R:\" with 9 numbers and a line \"T:\" with 3"};
  }
  Eigen::Matrix<double, 3, 4> matrix;
  matrix.leftCols<3>() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rotation.data());
  matrix.col(3) = Eigen::Map<const Eigen::Vector3d>(translation.data());
  return core::se3_from_matrix(matrix);
}

/// Pose of the IMU in a local east-north-up frame.
core::SE3 oxts_pose(const OxtsRecord& record, double scale) {
  constexpr double radians_per_degree = std::numbers::pi / 180.0;
  const core::Vector3& angles = record.roll_pitch_yaw;
  const Eigen::Quaterniond rotation = Eigen::AngleAxisd(angles.z(), core::Vector3::UnitZ()) *
                                      Eigen::AngleAxisd(angles.y(), core::Vector3::UnitY()) *
                                      Eigen::AngleAxisd(angles.x(), core::Vector3::UnitX());
  const core::Vector3 position(
      scale * kEarthRadiusM * record.longitude_deg * radians_per_degree,
      scale * kEarthRadiusM * std::log(std::tan((90.0 + record.latitude_deg) * radians_per_degree / 2.0)),
      record.altitude_m);
  return {rotation, position};
}

}  // namespace

std::optional<core::Time> parse_kitti_stamp(std::string_view text) {
  text = trim(text);
  if (text.size() < 19 || text[4] != '-' || text[7] != '-' || text[10] != ' ' || text[13] != ':' ||
      text[16] != ':') {
    return std::nullopt;
  }
  const auto year = parse_integer(text.substr(0, 4));
  const auto month = parse_integer(text.substr(5, 2));
  const auto day = parse_integer(text.substr(8, 2));
  const auto hour = parse_integer(text.substr(11, 2));
  const auto minute = parse_integer(text.substr(14, 2));
  const auto second = parse_integer(text.substr(17, 2));
  if (!year || !month || !day || !hour || !minute || !second) return std::nullopt;
  std::int64_t fraction_ns = 0;
  if (text.size() > 19) {
    std::string digits(text.substr(20));
    if (text[19] != '.' || digits.empty() || digits.size() > 9) return std::nullopt;
    digits.resize(9, '0');
    const auto fraction = parse_integer(digits);
    if (!fraction) return std::nullopt;
    fraction_ns = *fraction;
  }
  const std::chrono::year_month_day date{std::chrono::year(static_cast<int>(*year)),
                                         std::chrono::month(static_cast<unsigned>(*month)),
                                         std::chrono::day(static_cast<unsigned>(*day))};
  if (!date.ok() || *year < 1970 || *year > 2200 || *hour > 23 || *minute > 59 || *second > 60) {
    return std::nullopt;
  }
  const std::int64_t days = std::chrono::sys_days(date).time_since_epoch().count();
  const std::int64_t seconds = ((days * 24 + *hour) * 60 + *minute) * 60 + *second;
  return core::Time{seconds * kNanosecondsPerSecond + fraction_ns};
}

core::Result<std::vector<std::optional<core::Time>>> read_kitti_stamps(const fs::path& path) {
  std::ifstream file(path);
  if (!file) return core::Error{path.string() + ": cannot be opened; the drive is not unpacked completely"};
  std::vector<std::optional<core::Time>> stamps;
  std::string line;
  while (std::getline(file, line)) {
    const auto stamp = parse_kitti_stamp(line);
    if (!stamp && !trim(line).empty()) {
      return core::Error{path.string() + ":" + std::to_string(stamps.size() + 1) +
                         ": no time like 2011-09-26 13:08:24.957314930"};
    }
    stamps.push_back(stamp);
  }
  return stamps;
}

core::Result<KittiRawDrive> read_kitti_raw(const fs::path& drive, const fs::path& oxts_drive) {
  KittiRawDrive result;
  auto scans = read_scans(drive / "velodyne_points", result.scans_without_stamp);
  if (!scans) return scans.error();
  result.scans = std::move(scans).value();
  std::error_code ignored;
  if (oxts_drive == drive && !fs::exists(drive / "oxts", ignored)) return result;
  auto oxts = read_oxts(oxts_drive / "oxts");
  if (!oxts) return oxts.error();
  // A path that ends in '/' has an empty last component.
  const fs::path folder = drive.has_filename() ? drive : drive.parent_path();
  const auto T_lidar_imu = read_imu_to_lidar(fs::absolute(folder).parent_path() / "calib_imu_to_velo.txt");
  if (!T_lidar_imu) return T_lidar_imu.error();
  result.oxts = std::move(oxts).value();
  result.T_lidar_imu = *T_lidar_imu;
  return result;
}

core::Result<std::vector<KittiPoint>> read_kitti_scan(const fs::path& path) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) return core::Error{path.string() + ": cannot be opened"};
  const auto size = static_cast<std::size_t>(std::max<std::streamoff>(file.tellg(), 0));
  constexpr std::size_t max_bytes = 1U << 26U;
  if (size == 0 || size % sizeof(KittiPoint) != 0 || size > max_bytes) {
    return core::Error{path.string() + ": " + std::to_string(size) +
                       " bytes are no KITTI scan (16 per point); unpack the drive again"};
  }
  std::vector<KittiPoint> points(size / sizeof(KittiPoint));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(points.data()), static_cast<std::streamsize>(size));
  if (!file) return core::Error{path.string() + ": reading failed"};
  // Some files end in a point at the origin, which is no return.
  while (!points.empty() && points.back().x == 0.0F && points.back().y == 0.0F && points.back().z == 0.0F)
    points.pop_back();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const KittiPoint& p = points[i];
    if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z) || !std::isfinite(p.reflectance)) {
      return core::Error{path.string() + ": point " + std::to_string(i) +
                         " is not finite; unpack the drive again"};
    }
  }
  return points;
}

Trajectory oxts_trajectory(const std::vector<OxtsRecord>& records, const core::SE3& T_lidar_imu) {
  Trajectory trajectory;
  if (records.empty()) return trajectory;
  const double scale = std::cos(records.front().latitude_deg * std::numbers::pi / 180.0);
  const core::SE3 T_imu_lidar = T_lidar_imu.inverse();
  const core::SE3 T_start_world = (oxts_pose(records.front(), scale) * T_imu_lidar).inverse();
  for (const OxtsRecord& record : records) {
    trajectory.stamps.push_back(record.stamp);
    trajectory.poses.emplace_back((T_start_world * oxts_pose(record, scale) * T_imu_lidar).matrix());
  }
  return trajectory;
}

}  // namespace nilio::tools::convert
