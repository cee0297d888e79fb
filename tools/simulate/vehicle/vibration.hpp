#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/random.hpp"

#include <array>
#include <cstddef>
#include <vector>

namespace nilio::tools::simulate {

/// Vibration of a car's body that the rigid body on its wheels does not have, as displacement and rotation.
/// Band-pass noise, one resonator for each octave and axis. Called every `step_s`; one thread.
class StructuralVibration {
 public:
  StructuralVibration(double step_s, RandomStream random);
  /// Translation (m) and rotation vector (rad); `level`: 1 = that of the measured car at 17.8 m/s.
  core::Vector6 next(double level);

 private:
  struct Resonator {
    std::size_t axis = 0;
    double frequency_rad_s = 0.0;
    double drive = 0.0;
    double position = 0.0;
    double velocity = 0.0;
    /// Without what the velocity has far above the frequency, as rotation would turn that into acceleration.
    double output = 0.0;
  };
  double step_s_;
  RandomStream random_;
  std::vector<Resonator> resonators_;
  core::Vector6 integral_ = core::Vector6::Zero();
  core::Vector6 second_integral_ = core::Vector6::Zero();
};

/// Firing orders of a four-cylinder engine with five gears: orders 2 and 4 of the crankshaft.
class EngineVibration {
 public:
  explicit EngineVibration(double step_s) : step_s_(step_s) {}
  core::Vector6 next(double speed_m_s);

 private:
  double step_s_;
  double rpm_ = 850.0;
  double turns_ = 0.0;
};

}  // namespace nilio::tools::simulate
