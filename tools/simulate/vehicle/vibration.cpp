#include "tools/simulate/vehicle/vibration.hpp"

#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

using core::Vector6;

namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kDegree = kPi / 180.0;
constexpr std::size_t kBands = 6;
/// Middle of the bands 1-2, 2-4, 4-8, 8-16, 16-32 and 32-50 Hz.
constexpr std::array<double, kBands> kBandHz{1.4, 2.8, 5.6, 11.3, 22.6, 40.0};
constexpr double kDamping = 0.2;
/// Level of each band at 17.8 m/s: what the real car has beyond the rigid body on a class B road. m/s^2
/// forward, left, up; then deg/s of roll, pitch, yaw.
constexpr std::array<std::array<double, kBands>, 6> kLevels{{{.10, .14, .03, .22, .18, .15},
                                                             {.07, .03, .14, .18, .10, .06},
                                                             {.00, .07, .00, .25, .12, .12},
                                                             {.00, .10, .28, .06, .05, .24},
                                                             {.25, .72, .00, .22, .36, .15},
                                                             {.13, .06, .03, .10, .11, .11}}};
/// Integrals leak below 0.3 Hz, so that the body stays in place.
constexpr double kLeakRadS = 2.0 * kPi * 0.3;

}  // namespace

StructuralVibration::StructuralVibration(double step_s, RandomStream random)
    : step_s_(step_s), random_(random) {
  for (std::size_t axis = 0; axis < kLevels.size(); ++axis) {
    for (std::size_t band = 0; band < kBands; ++band) {
      const double level = kLevels[axis][band] * (axis < 3 ? 1.0 : kDegree);
      if (level <= 0.0) continue;
      const double omega = 2.0 * kPi * kBandHz[band];
      // The velocity of an oscillator driven by white noise of density S has the variance S / (4 zeta omega).
      resonators_.push_back({axis, omega, level * std::sqrt(4.0 * kDamping * omega / step_s), 0.0, 0.0, 0.0});
    }
  }
}

Vector6 StructuralVibration::next(double level) {
  Vector6 band_noise = Vector6::Zero();
  for (Resonator& r : resonators_) {
    const double force = level * r.drive * random_.gaussian() -
                         2.0 * kDamping * r.frequency_rad_s * r.velocity -
                         r.frequency_rad_s * r.frequency_rad_s * r.position;
    r.velocity += step_s_ * force;
    r.position += step_s_ * r.velocity;
    r.output += (1.0 - std::exp(-2.0 * r.frequency_rad_s * step_s_)) * (r.velocity - r.output);
    band_noise[static_cast<Eigen::Index>(r.axis)] += r.output;
  }
  const double keep = std::exp(-kLeakRadS * step_s_);
  integral_ = keep * integral_ + step_s_ * band_noise;
  second_integral_ = keep * second_integral_ + step_s_ * integral_;
  Vector6 displacement;
  // Levels are accelerations of the translation, rates of the rotation.
  displacement << second_integral_.head<3>(), integral_.tail<3>();
  return displacement;
}

Vector6 EngineVibration::next(double speed_m_s) {
  constexpr std::array<double, 5> kRpmPerSpeed{230.0, 130.0, 88.0, 66.0, 52.0};
  constexpr double kIdleRpm = 850.0;
  constexpr double kLeastRpm = 1150.0;
  constexpr double kSettleS = 0.3;
  double wanted = kIdleRpm;
  for (const double gear : kRpmPerSpeed) {
    const double rpm = gear * std::abs(speed_m_s);
    if (rpm >= kLeastRpm || wanted <= kIdleRpm) wanted = std::max(kIdleRpm, rpm);
  }
  rpm_ += (wanted - rpm_) * step_s_ / kSettleS;
  turns_ += rpm_ / 60.0 * step_s_;
  turns_ -= std::floor(turns_);
  // Forward, left, up in m/s^2; roll, pitch, yaw in deg/s, of order 2; order 4 has a third.
  const double load = rpm_ > kLeastRpm ? 1.0 : 0.3;
  Vector6 amplitude;
  amplitude << 0.04, 0.02, 0.06, 0.08 * kDegree, 0.15 * kDegree, 0.03 * kDegree;
  Vector6 displacement = Vector6::Zero();
  for (const double order : {2.0, 4.0}) {
    const double omega = 2.0 * kPi * order * rpm_ / 60.0;
    const double phase = 2.0 * kPi * order * turns_;
    const double share = load * (order > 2.0 ? 1.0 / 3.0 : 1.0);
    for (Eigen::Index axis = 0; axis < 6; ++axis) {
      const double scale = axis < 3 ? omega * omega : omega;
      displacement[axis] += share * amplitude[axis] / scale * std::sin(phase + static_cast<double>(axis));
    }
  }
  return displacement;
}

}  // namespace nilio::tools::simulate
