#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace nilio::ipc {

/// A point, metres: of a scan in base_link at its end; reflectivity 0..255.
struct CloudPoint {
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;
  float intensity = 0.0F;
};

/// Registered scan: its pose and a subset of its deskewed points, spread evenly. Passed between processes by
/// value; `points` beyond `count` are not transferred.
struct ScanCloud {
  static constexpr std::size_t kCapacity = 10'000;

  std::uint64_t sequence = 0;  ///< of the scan
  std::int64_t stamp_ns = 0;   ///< end of the scan; time of the pose
  /// T_odom_base.
  std::array<double, 3> position{};
  std::array<double, 4> orientation_xyzw{0.0, 0.0, 0.0, 1.0};
  /// Covariance of the registration against the local map, row-major over (x, y, z, rotation about x, y, z)
  /// in odom.
  std::array<double, 36> covariance{};
  std::uint64_t count = 0;
  std::array<CloudPoint, kCapacity> points;

  /// Bytes to transfer.
  [[nodiscard]] std::size_t bytes() const { return offsetof(ScanCloud, points) + count * sizeof(CloudPoint); }
};

/// Surfaces of a complete submap in odom, a subset spread evenly; passed between processes by value.
struct SubmapCloud {
  static constexpr std::size_t kCapacity = 20'000;

  std::uint64_t id = 0;
  std::int64_t stamp_ns = 0;  ///< of its first keyframe
  std::uint64_t count = 0;
  std::array<CloudPoint, kCapacity> points;

  /// Bytes to transfer.
  [[nodiscard]] std::size_t bytes() const {
    return offsetof(SubmapCloud, points) + count * sizeof(CloudPoint);
  }
};

/// Pose of the path.
struct PathPose {
  std::int64_t stamp_ns = 0;
  std::array<double, 3> position{};
  std::array<double, 4> orientation_xyzw{0.0, 0.0, 0.0, 1.0};
};

static_assert(std::is_trivially_copyable_v<ScanCloud> && std::is_trivially_copyable_v<SubmapCloud> &&
              std::is_trivially_copyable_v<PathPose>);

}  // namespace nilio::ipc
