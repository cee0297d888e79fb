#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/convert/kitti_raw.hpp"

#include <cstdint>
#include <span>
#include <string>

namespace nilio::tools {

/// What a capture contains compared with the scans it was made of.
struct ConversionCheck {
  std::uint64_t original_points = 0;
  std::uint64_t decoded_points = 0;
  /// Decoded points outside the time of every original scan.
  std::uint64_t unexplained_points = 0;
  /// From decoded points to the nearest original point of the same ring and scan, metres.
  double median_m = 0.0;
  double p99_m = 0.0;
  double max_m = 0.0;
};

/// Reads the capture back as niliod would, through the driver's own source and decoder, and compares it with
/// the scans.
core::Result<ConversionCheck> check_conversion(const std::string& pcap_path,
                                               std::span<const KittiRawScan> scans,
                                               const drivers::VelodyneSensor& sensor);

}  // namespace nilio::tools
