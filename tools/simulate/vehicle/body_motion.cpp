#include "tools/simulate/vehicle/body_motion.hpp"

#include "tools/simulate/vehicle/vibration.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::tools::simulate {

using core::Vector6;

namespace {

constexpr double kReferenceSpeed = 17.8;
/// The body settles on its springs for this long before the drive.
constexpr int kSettlingSteps = 4000;

// A car of 1.68 t; one corner has 380 kg on its spring.
constexpr double kBodyKg = 1520.0;
constexpr double kWheelKg = 40.0;
constexpr double kPitchInertia = kBodyKg * 1.30 * 1.30;
constexpr double kRollInertia = kBodyKg * 0.62 * 0.62;
constexpr double kSpring = 22e3;
constexpr double kDamper = 1.5e3;
constexpr double kTyre = 190e3;
/// Height of the centre of gravity, about which the rigid body turns.
constexpr double kGravityCentreM = 0.55;
/// Panels of the cabin vibrate about places near a sensor on them, not about the wheels.
const core::Vector3 kCabin(0.3, 0.0, 1.1);

/// The displacement of base_link when the body turns about `centre`.
Vector6 turned_about(Vector6 displacement, const core::Vector3& centre) {
  const core::Vector3 turn = displacement.tail<3>();
  displacement.head<3>() -= turn.cross(centre);
  return displacement;
}
constexpr double kHalfBaseM = 1.35;
constexpr double kHalfTrackM = 0.775;

struct Corner {
  double x = 0.0;
  double y = 0.0;
  double wheel = 0.0;
  double wheel_rate = 0.0;
};

/// Heave, pitch and roll of a rigid body on four wheels.
class RigidBody {
 public:
  void step(const RoadProfile& road, double distance_m, double dt) {
    double heave_force = 0.0;
    double pitch_moment = 0.0;
    double roll_moment = 0.0;
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      Corner& c = corners_[i];
      const double body = heave_ - c.x * pitch_ + c.y * roll_;
      const double body_rate = heave_rate_ - c.x * pitch_rate_ + c.y * roll_rate_;
      const double force = kSpring * (c.wheel - body) + kDamper * (c.wheel_rate - body_rate);
      heave_force += force;
      pitch_moment -= c.x * force;
      roll_moment += c.y * force;
      forces_[i] = force;
    }
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      Corner& c = corners_[i];
      const double road_m = road.height(distance_m + c.x, c.y > 0.0);
      c.wheel_rate += dt * (kTyre * (road_m - c.wheel) - forces_[i]) / kWheelKg;
      c.wheel += dt * c.wheel_rate;
    }
    heave_rate_ += dt * heave_force / kBodyKg;
    pitch_rate_ += dt * pitch_moment / kPitchInertia;
    roll_rate_ += dt * roll_moment / kRollInertia;
    heave_ += dt * heave_rate_;
    pitch_ += dt * pitch_rate_;
    roll_ += dt * roll_rate_;
  }
  [[nodiscard]] Vector6 displacement() const {
    Vector6 result;
    result << 0.0, 0.0, heave_, roll_, pitch_, 0.0;
    return result;
  }

 private:
  std::array<Corner, 4> corners_{{{kHalfBaseM, kHalfTrackM},
                                  {kHalfBaseM, -kHalfTrackM},
                                  {-kHalfBaseM, kHalfTrackM},
                                  {-kHalfBaseM, -kHalfTrackM}}};
  std::array<double, 4> forces_{};
  double heave_ = 0.0;
  double heave_rate_ = 0.0;
  double pitch_ = 0.0;
  double pitch_rate_ = 0.0;
  double roll_ = 0.0;
  double roll_rate_ = 0.0;
};

}  // namespace

BodyMotion::BodyMotion(const RoadSurface& surface, const RoadTravel& travel, std::uint64_t seed) {
  const std::size_t count = travel.speed_m_s.size();
  const auto [low, high] = std::minmax_element(travel.distance_m.begin(), travel.distance_m.end());
  const RoadProfile road(surface, *low - 5.0, *high + 5.0, seed);
  RigidBody body;
  StructuralVibration structure(kBodyStepS, RandomStream(seed, 63));
  EngineVibration engine(kBodyStepS);
  for (int i = 0; i < kSettlingSteps; ++i) {
    body.step(road, travel.distance_m.front(), kBodyStepS);
    structure.next(std::sqrt(std::abs(travel.speed_m_s.front()) / kReferenceSpeed));
    engine.next(travel.speed_m_s.front());
  }
  // Road excitation grows with the roughness, too.
  const double roughness = std::sqrt(surface.roughness_m3 / 64e-6);
  std::vector<Vector6> q(count + 2);
  for (std::size_t i = 0; i < count + 2; ++i) {
    const std::size_t k = std::min(i, count - 1);
    const double speed = travel.speed_m_s[k];
    body.step(road, travel.distance_m[k], kBodyStepS);
    const Vector6 vibration =
        structure.next(roughness * std::sqrt(std::abs(speed) / kReferenceSpeed)) + engine.next(speed);
    q[i] = turned_about(body.displacement(), {0.0, 0.0, kGravityCentreM}) + turned_about(vibration, kCabin);
  }
  displacement_.reserve(count);
  rate_.reserve(count);
  acceleration_.reserve(count);
  for (std::size_t i = 1; i + 1 < q.size(); ++i) {
    displacement_.push_back(q[i].cast<float>());
    rate_.push_back(((q[i + 1] - q[i - 1]) / (2.0 * kBodyStepS)).cast<float>());
    acceleration_.push_back(((q[i + 1] - 2.0 * q[i] + q[i - 1]) / (kBodyStepS * kBodyStepS)).cast<float>());
  }
}

BodyState BodyMotion::at(double time_s) const {
  const double index =
      std::clamp(time_s / kBodyStepS, 0.0, static_cast<double>(displacement_.size()) - 1.001);
  const auto i = static_cast<std::size_t>(index);
  const double u = index - static_cast<double>(i);
  const Vector6 q0 = displacement_[i].cast<double>();
  const Vector6 q1 = displacement_[i + 1].cast<double>();
  const Vector6 v0 = rate_[i].cast<double>();
  const Vector6 v1 = rate_[i + 1].cast<double>();
  BodyState state;
  // Cubic Hermite interpolation of the displacement; linear for its derivatives.
  const double h = kBodyStepS;
  state.displacement = (1.0 + 2.0 * u) * (1.0 - u) * (1.0 - u) * q0 + u * u * (3.0 - 2.0 * u) * q1 +
                       h * u * (1.0 - u) * ((1.0 - u) * v0 - u * v1);
  state.rate = (1.0 - u) * v0 + u * v1;
  state.acceleration = (1.0 - u) * acceleration_[i].cast<double>() + u * acceleration_[i + 1].cast<double>();
  return state;
}

}  // namespace nilio::tools::simulate
