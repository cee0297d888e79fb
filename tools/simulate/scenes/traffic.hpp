#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/town/ground.hpp"
#include "tools/simulate/town/street_layout.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::tools::simulate {

/// A vehicle that drives at constant speed along a path on the ground, optionally with one halt.
struct MovingCar {
  /// Below kVehicleModels.
  std::size_t model = 0;
  /// Points a metre apart on the ground.
  std::vector<core::Vector3> path;
  double speed_m_s = 0.0;
  /// Distance along the path at time 0; the car exists while 0 <= travelled < length of the path.
  double start_m = 0.0;
  /// Distance along the path and duration of the halt, braked and left with kHaltAcceleration; 0 s = none.
  double halt_m = 0.0;
  double halt_s = 0.0;

  /// Distance along the path, extrapolated beyond both ends.
  [[nodiscard]] double travelled_m(double time_s) const;
  /// T_world_car (x forward, origin on the ground under the centre); unset beyond the ends of the path.
  [[nodiscard]] std::optional<core::SE3> pose(double time_s) const;
};

/// m/s^2.
inline constexpr double kHaltAcceleration = 1.2;

/// Oncoming cars in the lane to the left of the driven one, and cars on side streets that cross shortly
/// before or after the vehicle passes; about `count`, fewer where there is no space. No car comes near the
/// vehicle (2.4 m to the side, 7 m ahead and behind) or another moving car.
std::vector<MovingCar> make_traffic(const VehicleTrajectory& trajectory, const StreetLayout& layout,
                                    const Ground& ground, std::size_t count, std::uint64_t seed);

}  // namespace nilio::tools::simulate
