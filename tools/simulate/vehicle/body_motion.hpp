#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/vehicle/road_surface.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace nilio::tools::simulate {

/// Small motion of the body relative to a smooth drive: translation in body axes (m), then rotation vector
/// (rad), and their time derivatives.
struct BodyState {
  core::Vector6 displacement = core::Vector6::Zero();
  core::Vector6 rate = core::Vector6::Zero();
  core::Vector6 acceleration = core::Vector6::Zero();
};

/// Signed speed along the road and distance, every kBodyStepS.
struct RoadTravel {
  std::vector<double> speed_m_s;
  std::vector<double> distance_m;
};
inline constexpr double kBodyStepS = 0.001;

/// Body of a car on a road: heave, pitch and roll of a rigid body on four wheels (body modes at 1 to 2 Hz,
/// wheel hop at 12 Hz), structural vibration in all six axes, and the firing orders of a four-cylinder
/// engine. Vibration is scaled with the square root of the speed, as road excitation; levels are those of a
/// real car's 104 Hz IMU. 1 kHz; immutable.
class BodyMotion {
 public:
  BodyMotion(const RoadSurface& surface, const RoadTravel& travel, std::uint64_t seed);
  [[nodiscard]] BodyState at(double time_s) const;

 private:
  using Six = Eigen::Matrix<float, 6, 1>;
  std::vector<Six> displacement_;
  std::vector<Six> rate_;
  std::vector<Six> acceleration_;
};

}  // namespace nilio::tools::simulate
