#pragma once

#include "daemon/config/config.hpp"
#include "daemon/config/convert.hpp"
#include "tests/support/capture_bytes.hpp"
#include "tests/support/room_drive.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::tests {

/// Two VLP-16 at different positions, distinguished by their addresses 192.168.1.201 and 192.168.1.202.
inline daemon::Config two_lidars() {
  daemon::Config config;
  config.lidar.sender_address = "192.168.1.201";
  config.lidar.extrinsic = {{1.2, 0.4, 0.3}, {0.0, 0.0, 20.0}};
  daemon::ExtraLidarConfig& second = config.more_lidars[0];
  second.enabled = true;
  second.sender_address = "192.168.1.202";
  second.extrinsic = {{-1.0, -0.5, 0.2}, {0.0, 25.0, -70.0}};
  return config;
}

/// Writes lidar.pcap of a drive through the room with both LiDARs; the second one falls silent after a time.
inline void write_two_lidar_drive(const std::filesystem::path& folder, const PoseFunction& T_world_base,
                                  double seconds, double seconds_of_second) {
  const Room room = Room::with_pillars();
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  const daemon::Config config = two_lidars();
  const std::int64_t period_ns = sensor.single().packet_period_ns;
  struct Datagram {
    std::int64_t stamp_ns;
    std::string frame;
  };
  std::vector<Datagram> datagrams;
  const auto drive = [&](const daemon::ExtrinsicConfig& mounting, std::uint8_t host, std::int64_t first_ns,
                         double until) {
    const core::SE3 T_base_lidar = daemon::to_transform(mounting);
    const auto pose = [&](double t) { return T_world_base(t) * T_base_lidar; };
    for (std::int64_t t = first_ns; static_cast<double>(t) * 1e-9 < until; t += period_ns) {
      const auto bytes = drivers::encode(room_packet(room, pose, sensor, t));
      const std::string_view payload(reinterpret_cast<const char*>(bytes.data()), bytes.size());
      datagrams.push_back({kDriveStartNs + t + period_ns + 100'000,
                           link_frame(kLinkEthernet, ipv4_udp(2368, payload, host))});
    }
  };
  drive(config.lidar.extrinsic, 201, 0, seconds);
  drive(config.more_lidars[0].extrinsic, 202, 400'000, seconds_of_second);
  std::stable_sort(datagrams.begin(), datagrams.end(),
                   [](const Datagram& a, const Datagram& b) { return a.stamp_ns < b.stamp_ns; });
  PcapText capture(kLinkEthernet);
  for (const Datagram& datagram : datagrams) capture.packet(datagram.stamp_ns, datagram.frame);
  std::ofstream(folder / "lidar.pcap", std::ios::binary) << capture.bytes();
}

/// Distance of a point from the nearest wall or pillar of the room.
inline double distance_to_surface(const Room& room, const core::Vector3& p) {
  double nearest = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis)
    nearest = std::min({nearest, std::abs(p[axis] - room.low[axis]), std::abs(p[axis] - room.high[axis])});
  for (const Room::Pillar& pillar : room.pillars) {
    const double outside =
        std::max(std::abs(p.x() - pillar.x), std::abs(p.y() - pillar.y)) - pillar.half_width;
    nearest = std::min(nearest, std::abs(outside));
  }
  return nearest;
}

}  // namespace nilio::tests
