#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/convert/kitti_raw.hpp"

#include <cstdint>
#include <span>
#include <string>

namespace nilio::tools::convert {

/// A capture compared with the scans it was made of.
struct ConversionCheck {
  std::uint64_t original_points = 0;
  std::uint64_t decoded_points = 0;
  /// Decoded points outside the time span of every original scan.
  std::uint64_t unexplained_points = 0;
  /// Distance of decoded points to the nearest original point of the same ring and scan, metres.
  double median_m = 0.0;
  double p99_m = 0.0;
  double max_m = 0.0;
};

/// Reads the capture back as niliod would, through the driver's own source and decoder, and compares it with
/// the scans.
core::Result<ConversionCheck> check_conversion(const std::string& pcap_path,
                                               std::span<const KittiRawScan> scans,
                                               const drivers::VelodyneSensor& sensor);

/// Options of "nilio convert kitti-raw".
struct Options {
  /// Folder of the unpacked drive.
  std::string drive;
  /// Folder for the recording, created if missing.
  std::string output;
  /// Drive to take the OXTS records from; empty = `drive`.
  std::string oxts_drive;
};

/// Converts a drive to lidar.pcap, imu.candump.log, truth.tum, gnss.csv and nilio.yaml, prints a summary, and
/// reads the capture back. Returns the exit status: 1 when the capture does not give the scans back.
core::Result<int> convert_kitti_raw(const Options& options);

}  // namespace nilio::tools::convert
