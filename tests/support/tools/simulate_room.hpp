#pragma once

#include "nilio/drivers/velodyne/decoder.hpp"

#include "tests/support/synthetic_room.hpp"
#include "tools/simulate/sensors/lidar_model.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

inline constexpr core::Time kRoomStart{1'767'268'800'000'000'000};  // 2026-01-01 12:00

/// The hall of synthetic_room.hpp as triangles.
inline tools::simulate::TriangleMesh room_mesh(const Room& room) {
  using core::Vector3;
  constexpr auto kMaterial = tools::simulate::Material::kPlaster;
  tools::simulate::TriangleMesh mesh;
  const auto box = [&](const Vector3& low, const Vector3& high) { mesh.add_box({}, low, high, kMaterial); };
  box(room.low, room.high);
  for (const Room::Pillar& pillar : room.pillars) {
    const Vector3 half(pillar.half_width, pillar.half_width, 0.0);
    const Vector3 middle(pillar.x, pillar.y, 0.0);
    box(middle - half + Vector3(0.0, 0.0, room.low.z()), middle + half + Vector3(0.0, 0.0, room.high.z()));
  }
  return mesh;
}

/// A bend with some wobble through the hall at 8 m/s; base_link is on the floor.
inline std::vector<core::SE3> room_drive(double duration_s) {
  std::vector<core::SE3> poses;
  const long last = std::lround(duration_s / tools::simulate::kControlIntervalS);
  for (long i = 0; i <= last; ++i) {
    const double t = static_cast<double>(i) * tools::simulate::kControlIntervalS;
    const core::Vector3 turn(0.02 * std::sin(5.0 * t), 0.02 * std::cos(7.0 * t), 0.3 * t);
    poses.push_back({core::so3_exp(turn), {8.0 * t, 0.5 * t, -1.75}});
  }
  return poses;
}

struct RoomWorld {
  Room room = Room::with_pillars();
  tools::simulate::VehicleTrajectory trajectory;
  tools::simulate::RayScene scene;
};

inline RoomWorld make_room_world(const std::vector<core::SE3>& poses) {
  using namespace tools::simulate;
  const Room room = Room::with_pillars();
  auto scene = RayScene::create(room_mesh(room), {});
  REQUIRE(scene.ok());
  return {room, VehicleTrajectory(poses, kControlIntervalS), std::move(scene).value()};
}

inline tools::simulate::LidarModelConfig room_config(
    drivers::ReturnMode mode = drivers::ReturnMode::kSingle) {
  tools::simulate::LidarModelConfig config;
  config.start = kRoomStart;
  config.T_base_lidar = {core::so3_exp({0.0, 0.01, 0.02}), {0.3, 0.0, 1.73}};
  config.range_noise_m = 0.0;
  config.return_mode = mode;
  return config;
}

inline drivers::Packet as_packet(core::Time stamp, std::span<const std::uint8_t> payload) {
  drivers::Packet packet;
  packet.stamp = stamp;
  packet.size = static_cast<std::uint16_t>(payload.size());
  std::copy(payload.begin(), payload.end(), packet.data.begin());
  return packet;
}

}  // namespace nilio::tests
