#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/town/ground.hpp"
#include "tools/simulate/town/street_layout.hpp"
#include "tools/simulate/vehicle/vehicle_trajectory.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::tools::simulate {

/// A vehicle that drives at constant speed along a line on the ground, and may stop on its way.
struct MovingCar {
  /// Below kVehicleModels.
  std::size_t model = 0;
  /// Places a metre apart on the ground.
  std::vector<core::Vector3> path;
  double speed_m_s = 0.0;
  /// Where on the path the car is at time 0; it is there while 0 <= travelled < length of the path.
  double start_m = 0.0;
  /// Where on the path it stops, and how long; it brakes and sets off with kHaltAcceleration.
  double halt_m = 0.0;
  double halt_s = 0.0;

  /// How far along the path it is, as if the path went on at both ends.
  [[nodiscard]] double travelled_m(double time_s) const;
  /// T_world_car (x forward, origin on the ground under the centre) where the car is on its path.
  [[nodiscard]] std::optional<core::SE3> pose(double time_s) const;
};

/// m/s^2.
inline constexpr double kHaltAcceleration = 1.2;

/// Oncoming cars in the lane to the left of the driven one, and cars on side streets that cross shortly
/// before or after the vehicle passes; about `count`, fewer where there is no room. No car comes near the
/// vehicle's own way (2.4 m to the side, 7 m ahead and behind) at the time it is there, nor into another
/// moving car.
std::vector<MovingCar> make_traffic(const VehicleTrajectory& trajectory, const StreetLayout& layout,
                                    const Ground& ground, std::size_t count, std::uint64_t seed);

}  // namespace nilio::tools::simulate
