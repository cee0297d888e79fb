#include "tools/convert/capture.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "tools/common/files.hpp"
#include "tools/common/progress.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <span>
#include <string>
#include <system_error>

namespace nilio::tools::convert {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr const char* kIndex = "scans.csv";
constexpr std::size_t kBatch = 64;

Result<daemon::Input> open_input(const CaptureOptions& options, daemon::Config& config) {
  const auto files = daemon::find_replay_files({options.recording});
  if (!files) return files.error();
  if (!files->kitti_sequence.empty())
    return Error{files->kitti_sequence + ": has no packets - its velodyne/*.bin are point clouds already"};
  auto loaded = daemon::replay_config(*files, options.config_file);
  if (!loaded) return loaded.error();
  config = std::move(loaded).value();
  if (auto applied = daemon::apply_overrides(config, options.overrides); !applied) return applied.error();
  config.imu.enabled = false;
  auto input = daemon::open_replay(*files, config);
  if (input) std::erase_if(input->notes, [](const std::string& note) { return note.starts_with("imu."); });
  return input;
}

/// Writes scans and their index.
class ScanWriter {
 public:
  explicit ScanWriter(const CaptureOptions& options)
      : options_(options), index_(fs::path(options.output) / kIndex) {
    index_ << "file,start_ns,end_ns,points,coverage_deg,lost_packets\n";
  }

  /// Scan number `next_`; those out of the wanted range are left out.
  Result<std::monostate> add(const core::Scan& scan) {
    const std::uint64_t number = next_++;
    if (number < options_.first || number - options_.first >= options_.count) return std::monostate{};
    std::array<char, 32> name{};
    std::snprintf(name.data(), name.size(), "scan_%06llu.%s", static_cast<unsigned long long>(number),
                  extension_of(options_.format));
    const fs::path path = fs::path(options_.output) / name.data();
    if (auto written = write_points(scan, options_.format, path.string()); !written) return written;
    index_ << name.data() << ',' << scan.start.ns << ',' << scan.end.ns << ',' << scan.points.size() << ','
           << scan.coverage_deg << ',' << scan.lost_packets << '\n';
    points_ += scan.points.size();
    ++written_;
    return std::monostate{};
  }

  [[nodiscard]] bool is_done() const {
    return next_ > options_.first && next_ - options_.first >= options_.count;
  }
  Result<std::monostate> finish() {
    index_.close();
    const std::string folder = options_.output;
    if (!index_)
      return Error{(fs::path(folder) / kIndex).string() +
                   ": could not be written - check the folder and the space on the disk"};
    if (written_ == 0)
      return Error{folder + ": no scan was written (" + std::to_string(next_) +
                   " in the recording) - check --first, lidar.port and lidar.model"};
    std::cout << folder << ": " << written_ << " scans, " << points_ << " points, times in " << kIndex
              << '\n';
    return std::monostate{};
  }
  [[nodiscard]] std::uint64_t seen() const { return next_; }

 private:
  const CaptureOptions& options_;
  std::ofstream index_;
  std::uint64_t next_ = 0;
  std::uint64_t written_ = 0;
  std::uint64_t points_ = 0;
};

/// Scans of point clouds.
Result<std::monostate> write_clouds(daemon::ScanFeed& scans, ScanWriter& writer) {
  Progress progress("scans written");
  core::Scan scan;
  while (!writer.is_done() && scans.next(scan, core::Duration{}) == daemon::FeedState::kScan) {
    progress.update(writer.seen());
    if (auto written = writer.add(scan); !written) return written;
  }
  return std::monostate{};
}

Result<std::monostate> write_scans(daemon::Input& input, const daemon::LidarConfig& lidar,
                                   ScanWriter& writer) {
  drivers::ScanAssemblerConfig config = daemon::assembler_config(lidar);
  config.min_range_m = 0.0;
  config.max_range_m = 1000.0;
  config.min_coverage = 0.0;
  drivers::ScanAssembler assembler(*input.sensor, config);
  Progress progress("scans written");
  core::Scan scan;
  const auto take = [&]() -> Result<std::monostate> {
    assembler.take_scan(scan);
    progress.update(writer.seen());
    return writer.add(scan);
  };
  std::vector<drivers::Packet> packets(kBatch);
  while (!writer.is_done()) {
    const drivers::SourceRead read = input.packets->read(packets, core::Duration{});
    if (read.state == drivers::SourceState::kFailed) return Error{input.packets->status()};
    if (read.state != drivers::SourceState::kData) break;
    for (const drivers::Packet& packet : std::span(packets).first(read.count)) {
      if (!assembler.add(packet)) continue;
      if (auto taken = take(); !taken) return taken;
    }
  }
  if (!writer.is_done() && assembler.finish()) return take();
  return std::monostate{};
}

/// A field of a point, with its type in both binary formats.
struct Field {
  const char* name;
  char pcd_type;
  std::size_t bytes;
  const char* ply_type;
};

constexpr std::array<Field, 8> kFields{{{"x", 'F', 4, "float"},
                                        {"y", 'F', 4, "float"},
                                        {"z", 'F', 4, "float"},
                                        {"intensity", 'F', 4, "float"},
                                        {"ring", 'U', 2, "ushort"},
                                        {"return", 'U', 1, "uchar"},
                                        {"time", 'F', 4, "float"},
                                        {"azimuth", 'F', 4, "float"}}};

/// Degrees, 0 to 360.
float azimuth_of(const core::Point& point) {
  const double degrees =
      -std::atan2(static_cast<double>(point.y), static_cast<double>(point.x)) * kDegreesPerRadian;
  const auto azimuth = static_cast<float>(degrees < 0.0 ? degrees + 360.0 : degrees);
  return azimuth < 360.0F ? azimuth : 0.0F;
}

/// Values of a point in the order of kFields, without padding, in the byte order of the machine.
std::string binary_record(const core::Point& point) {
  std::string record;
  const auto add = [&record](const auto value) {
    std::array<char, sizeof value> bytes{};
    std::memcpy(bytes.data(), &value, sizeof value);
    record.append(bytes.data(), bytes.size());
  };
  for (const float value : {point.x, point.y, point.z, point.intensity}) add(value);
  add(point.ring);
  add(static_cast<std::uint8_t>(point.return_kind));
  add(static_cast<float>(1e-9 * point.time_offset_ns));
  add(azimuth_of(point));
  return record;
}

std::string csv_record(const core::Point& p) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "%.6f,%.6f,%.6f,%g,%u,%u,%.9f,%.6f\n", static_cast<double>(p.x),
                static_cast<double>(p.y), static_cast<double>(p.z), static_cast<double>(p.intensity), p.ring,
                p.return_kind, 1e-9 * p.time_offset_ns, static_cast<double>(azimuth_of(p)));
  return text.data();
}

std::string pcd_header(std::size_t points) {
  std::array<std::string, 4> lines{"FIELDS", "SIZE", "TYPE", "COUNT"};
  for (const Field& field : kFields) {
    lines[0] += std::string(" ") + field.name;
    lines[1] += " " + std::to_string(field.bytes);
    lines[2] += std::string(" ") + field.pcd_type;
    lines[3] += " 1";
  }
  std::string text = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n";
  for (const std::string& line : lines) text += line + "\n";
  const std::string count = std::to_string(points);
  return text + "WIDTH " + count + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + count + "\nDATA binary\n";
}

std::string ply_header(std::size_t points) {
  std::string text = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(points) + "\n";
  for (const Field& field : kFields)
    text += std::string("property ") + field.ply_type + " " + field.name + "\n";
  return text + "end_header\n";
}

std::string csv_header() {
  std::string text;
  for (const Field& field : kFields) text += std::string(text.empty() ? "" : ",") + field.name;
  return text + "\n";
}

}  // namespace

Result<std::monostate> convert_capture(const CaptureOptions& options) {
  daemon::Config config;
  Result<daemon::Input> input = open_input(options, config);
  if (!input) return input.error();
  for (const std::string& note : input->notes) std::cout << note << '\n';
  for (const std::string& warning : input->warnings) std::cerr << "warning: " << warning << '\n';
  std::error_code error;
  fs::create_directories(options.output, error);
  if (error)
    return Error{options.output + ": could not be created (" + error.message() + ") - choose another folder"};
  if (fs::exists(fs::path(options.output) / kIndex, error))
    return Error{options.output + ": holds an earlier conversion (" + kIndex + ") - choose another folder"};
  ScanWriter writer(options);
  auto written =
      input->scans ? write_clouds(*input->scans, writer) : write_scans(*input, config.lidar, writer);
  if (!written) return written;
  return writer.finish();
}

const char* extension_of(PointFormat format) {
  static constexpr std::array kExtensions{"pcd", "ply", "csv"};
  return kExtensions[static_cast<std::size_t>(format)];
}

core::Result<std::monostate> write_points(const core::Scan& scan, PointFormat format,
                                          const std::string& path) {
  std::string content = format == PointFormat::kPcd   ? pcd_header(scan.points.size())
                        : format == PointFormat::kPly ? ply_header(scan.points.size())
                                                      : csv_header();
  for (const core::Point& point : scan.points)
    content += format == PointFormat::kCsv ? csv_record(point) : binary_record(point);
  const UnfinishedFile unfinished(path);
  std::ofstream file(unfinished.path(), std::ios::binary);
  file.write(content.data(), static_cast<std::streamsize>(content.size()));
  file.close();
  if (!file) return core::Error{path + ": could not be written - check the folder and the space on the disk"};
  return unfinished.finish();
}

}  // namespace nilio::tools::convert
