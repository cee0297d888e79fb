#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/units.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>

namespace nilio::tests {

/// All packets of a capture, on both ports.
inline std::vector<drivers::Packet> read_capture(const std::string& path) {
  std::vector<drivers::Packet> packets;
  auto source = drivers::open_pcap(path, {});
  if (!source.ok()) return packets;
  std::vector<drivers::Packet> slots(64);
  for (;;) {
    const drivers::SourceRead read = (*source)->read(slots, core::Duration{});
    if (read.state != drivers::SourceState::kData) return packets;
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  }
}

/// Positions of a binary PCD file whose first fields are x, y and z as floats.
inline std::vector<Eigen::Vector3f> read_pcd(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::size_t points = 0;
  std::size_t point_size = 0;
  for (std::string line; std::getline(file, line) && line.rfind("DATA", 0) != 0;) {
    std::istringstream words(line);
    std::string key;
    words >> key;
    if (key == "POINTS") words >> points;
    std::size_t size = 0;
    while (key == "SIZE" && words >> size) point_size += size;
  }
  std::vector<Eigen::Vector3f> cloud(points);
  std::vector<char> record(point_size);
  for (Eigen::Vector3f& p : cloud) {
    file.read(record.data(), static_cast<std::streamsize>(point_size));
    std::memcpy(p.data(), record.data(), 3 * sizeof(float));
  }
  return cloud;
}

/// A point in sensor coordinates: laser, range, direction.
struct Sighting {
  std::size_t laser = 0;
  std::int64_t range = 0;  ///< in steps of the sensor's resolution
  double azimuth_deg = 0.0;
  bool used = false;
};

/// For points without vertical offset, whose elevation identifies the laser.
inline Sighting sighting_of(const Eigen::Vector3d& p, const drivers::VelodyneSensor& sensor) {
  Sighting sighting;
  const double elevation = std::atan2(p.z(), p.head<2>().norm());
  for (std::size_t i = 1; i < sensor.lasers.size(); ++i) {
    if (std::abs(sensor.lasers[i].elevation_rad - elevation) <
        std::abs(sensor.lasers[sighting.laser].elevation_rad - elevation))
      sighting.laser = i;
  }
  sighting.range = std::llround(p.norm() / sensor.distance_resolution_m);
  sighting.azimuth_deg = -std::atan2(p.y(), p.x()) * nilio::kDegreesPerRadian;
  return sighting;
}

/// Decoded points, to be matched once each.
class SightingIndex {
 public:
  SightingIndex(const core::Scan& scan, const drivers::VelodyneSensor& sensor) {
    for (const core::Point& p : scan.points) {
      const Sighting sighting = sighting_of(Eigen::Vector3f(p.x, p.y, p.z).cast<double>(), sensor);
      sightings_.emplace(key_of(sighting), sighting);
    }
  }

  /// Removes the point of the same laser and range with the nearest azimuth; false when none is within
  /// `tolerance_deg`.
  bool take(const Sighting& wanted, double tolerance_deg) {
    Sighting* best = nullptr;
    double best_difference = tolerance_deg;
    const auto range = sightings_.equal_range(key_of(wanted));
    for (auto it = range.first; it != range.second; ++it) {
      const double difference = std::abs(std::remainder(it->second.azimuth_deg - wanted.azimuth_deg, 360.0));
      if (it->second.used || difference > best_difference) continue;
      best = &it->second;
      best_difference = difference;
    }
    if (best != nullptr) best->used = true;
    return best != nullptr;
  }

 private:
  static std::uint64_t key_of(const Sighting& s) {
    return static_cast<std::uint64_t>(s.range) << 8 | static_cast<std::uint64_t>(s.laser);
  }
  std::unordered_multimap<std::uint64_t, Sighting> sightings_;
};

/// The reference decoder's model where it differs from nilio's: no vertical offset, and
/// - VLP-32C: the azimuth advances with every entry, although pairs fire together;
/// - VLS-128: the sensor pauses for one slot after eight groups instead of two, and only the last bank's
/// azimuth
///   advances: the reference takes the rate from the next block, which has the same azimuth in the other
///   banks.
inline void use_reference_conventions(drivers::VelodyneSensor& sensor) {
  for (drivers::LaserCalibration& laser : sensor.lasers) laser.vertical_offset_m = 0.0;
  for (drivers::PacketLayout& layout : sensor.layouts) {
    for (auto& block : layout.entries) {
      for (std::size_t c = 0; c < block.size(); ++c) {
        drivers::PacketEntry& entry = block[c];
        if (sensor.model == drivers::VelodyneModel::kVlp32c)
          entry.azimuth_fraction = static_cast<float>(2.304 * static_cast<double>(c) / 55.296);
        if (sensor.model == drivers::VelodyneModel::kVls128)
          entry.azimuth_fraction =
              entry.laser < 96 ? 0.0F : entry.azimuth_fraction - static_cast<float>(2.665 / 53.3);
      }
    }
  }
}

inline void stop_interpolating(drivers::VelodyneSensor& sensor) {
  for (drivers::PacketLayout& layout : sensor.layouts) {
    for (auto& block : layout.entries) {
      for (drivers::PacketEntry& entry : block) entry.azimuth_fraction = 0.0F;
    }
  }
}

}  // namespace nilio::tests
