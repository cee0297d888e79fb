#include "core/src/imu_monitor/check_table.hpp"

#include "nilio/core/imu_health.hpp"
#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "core/src/estimation/stationary_detector.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace nilio::core {

namespace {

// Above this angle axes are swapped; below it the mounting is tilted.
constexpr double kOtherAxisDegrees = 45.0;
constexpr double kOtherUnit = 2.0;
constexpr double kBetterBelow = 0.8;

/// Thresholds hold for the distance from `normal`.
struct Row {
  const char* name;
  const char* unit;
  double normal;
  double warn;
  double bad;
  const char* hint;
};

/// In the order of ImuCheck.
constexpr std::array<Row, kImuChecks> kRows = {{
    {"gyro_agreement", "deg/scan", 0.0, 0.3, 1.0,
     "the gyroscope and the LiDAR see different rotations; the rows that are bad say why"},
    {"gyro_axes", "deg", 0.0, 45.0, 45.0, ""},
    {"gyro_mounting", "deg", 0.0, 4.0, 8.0,
     "the gyroscope is mounted at an angle that imu.extrinsic.rotation_rpy_deg does not have (or "
     "lidar.extrinsic); measure or correct it"},
    {"gyro_scale", "1", 1.0, 0.03, 0.1,
     "the rate's scale is wrong; check unit and scale in imu.dbc's mapping"},
    {"gyro_bias", "deg/s", 0.0, 1.0, 5.0,
     "the gyroscope's bias is larger than a sound one's; it is estimated and subtracted; let the IMU warm up "
     "or calibrate it"},
    {"gyro_noise", "deg/s", 0.0, 2.0, 10.0,
     "strong vibration or electrical noise; mount the IMU more softly, or turn its low-pass filter on"},
    {"gyro_saturation", "deg/s", 0.0, 0.0, 0.0,
     "the gyroscope clips at this rate; set a larger full-scale range in the IMU"},
    {"gyro_stuck", "s", 0.0, 0.3, 0.5,
     "the rates never change; the IMU or its gateway repeats an old frame: restart it"},
    {"gravity_magnitude", "m/s^2", kGravity, 0.3, kGravityTolerance,
     "specific force at steady speed should be 9.81 m/s^2; check the accelerometer's unit and scale"},
    {"gravity_direction", "deg", 0.0, 12.0, 25.0,
     "gravity is not along base_link's z; check imu.extrinsic.rotation_rpy_deg and the axes of the mapping"},
    {"accel_mounting", "deg", 0.0, 4.0, 8.0,
     "accelerometer and registered acceleration differ by this rotation; check "
     "imu.extrinsic.rotation_rpy_deg"},
    {"accel_vibration", "m/s^2", 0.0, 3.0, 10.0,
     "strong vibration; mount the IMU more softly, or turn its low-pass filter on"},
    {"accel_saturation", "m/s^2", 0.0, 0.0, 0.0,
     "the accelerometer clips at this force; set a larger full-scale range in the IMU"},
    {"accel_stuck", "s", 0.0, 0.3, 0.5,
     "the forces never change; the IMU or its gateway repeats an old frame: restart it"},
    {"time_offset", "ms", 0.0, 10.0, 30.0, ""},
    {"sample_loss", "%", 0.0, 2.0, 20.0,
     "samples are missing between others; check the load of the bus, its bit rate and wiring"},
    {"sample_gap", "s", 0.0, 0.05, 0.15,
     "the IMU was silent for this long; check its power and connectors; rotation is predicted without it "
     "meanwhile"},
}};

const Row& row_of(ImuCheck check) { return kRows[static_cast<std::size_t>(check)]; }

void set_state(ImuDiagnosis& row, ImuCheckState state, double threshold) {
  row.state = state;
  row.threshold = threshold;
  if (state < row.worst_state) return;
  if (state > row.worst_state || std::abs(row.value) > std::abs(row.worst_value)) row.worst_value = row.value;
  row.worst_state = state;
}

std::string axis_name(int axis) {
  return std::string(axis < 0 ? "-" : "+") + "xyz"[static_cast<std::size_t>(std::abs(axis) - 1)];
}

std::string axes_hint(const ImuHealth& health) {
  std::string text;
  for (int axis = 1; axis <= 3; ++axis) {
    const int measured = health.measured_on[static_cast<std::size_t>(axis - 1)];
    if (measured == 0 || measured == axis) continue;
    text +=
        "rotation about " + axis_name(axis) + " of base_link is measured on " + axis_name(measured) + "; ";
  }
  return text +
         "axes are swapped or signs flipped: correct imu.extrinsic.rotation_rpy_deg or the mapping's scales";
}

std::string offset_hint(const ImuHealth& health) {
  const double value = health[ImuCheck::kTimeOffset].value;
  std::array<char, 200> text{};
  std::snprintf(text.data(), text.size(),
                "the IMU's stamps are %.1f ms (+- %.1f) %s than the LiDAR's for the same instant; check both "
                "clocks and the bus's delay, or add %.1f to imu.time_offset_ms",
                std::abs(value), health.time_offset_sigma_ms, value > 0.0 ? "later" : "earlier", value);
  return text.data();
}

std::string unit_hint(const char* usual, double ratio, double suspicious, const char* explanation) {
  return std::abs(ratio / suspicious - 1.0) < 0.1 ? std::string(explanation) : std::string(usual);
}

}  // namespace

const char* name_of(ImuCheck check) { return check < ImuCheck::kCount ? row_of(check).name : "none"; }
const char* unit_of(ImuCheck check) { return check < ImuCheck::kCount ? row_of(check).unit : ""; }
double normal_of(ImuCheck check) { return check < ImuCheck::kCount ? row_of(check).normal : 0.0; }

ImuCheckLimits limits_of(ImuCheck check) {
  return check < ImuCheck::kCount ? ImuCheckLimits{row_of(check).warn, row_of(check).bad} : ImuCheckLimits{};
}

const char* name_of(ImuCheckState state) {
  constexpr std::array names = {"unknown", "ok", "warn", "bad"};
  return names[static_cast<std::size_t>(state) % names.size()];
}

std::string hint_for(ImuCheck check, const ImuHealth& health) {
  if (check >= ImuCheck::kCount || health[check].state < ImuCheckState::kWarn) return {};
  const char* const usual = row_of(check).hint;
  const double value = health[check].value;
  if (check == ImuCheck::kGyroAxes) return axes_hint(health);
  if (check == ImuCheck::kTimeOffset) return offset_hint(health);
  if (check == ImuCheck::kGyroScale) {
    if (std::abs(value * kDegreesPerRadian - 1.0) < 0.1)
      return "rates are in rad/s but read as deg/s: multiply their scale by 57.2958";
    return unit_hint(usual, value, kDegreesPerRadian,
                     "rates are in deg/s but read as rad/s: divide their scale by 57.2958");
  }
  if (check == ImuCheck::kGravityMagnitude)
    return unit_hint(usual, value, 1.0, "forces are in g but read as m/s^2: multiply their scale by 9.80665");
  return usual;
}

void set_row(ImuHealth& health, ImuCheck check, double value, double sigma) {
  const Row& limits = row_of(check);
  ImuDiagnosis& row = health.rows[static_cast<std::size_t>(check)];
  row.value = value;
  const double distance = std::max(0.0, std::abs(value - limits.normal) - 3.0 * sigma);
  const double bad = row.state == ImuCheckState::kBad ? kBetterBelow * limits.bad : limits.bad;
  const double warn = row.state >= ImuCheckState::kWarn ? kBetterBelow * limits.warn : limits.warn;
  if (distance > bad) {
    set_state(row, ImuCheckState::kBad, limits.bad);
  } else {
    set_state(row, distance > warn ? ImuCheckState::kWarn : ImuCheckState::kOk, limits.warn);
  }
}

void set_flag_row(ImuHealth& health, ImuCheck check, double value) {
  ImuDiagnosis& row = health.rows[static_cast<std::size_t>(check)];
  row.value = value;
  set_state(row, value > 0.0 ? ImuCheckState::kBad : ImuCheckState::kOk, 0.0);
}

void clear_row(ImuHealth& health, ImuCheck check) {
  health.rows[static_cast<std::size_t>(check)].state = ImuCheckState::kUnknown;
}

namespace {

double angle_between(const Vector3& a, const Vector3& b) {
  return portable::acos(std::clamp(a.dot(b), -1.0, 1.0)) * kDegreesPerRadian;
}

/// Records the sensor axis on which the dominant axis of a direction is measured.
void note_axis(const Vector3& gyro, const Vector3& registered, ImuHealth& health) {
  Eigen::Index from = 0;
  Eigen::Index to = 0;
  registered.cwiseAbs().maxCoeff(&from);
  gyro.cwiseAbs().maxCoeff(&to);
  const int sign = registered[from] * gyro[to] < 0.0 ? -1 : 1;
  health.measured_on[static_cast<std::size_t>(from)] =
      static_cast<std::int8_t>(sign * (static_cast<int>(to) + 1));
}

void fill_axes(const GyroAlignmentEstimate& estimate, ImuHealth& health) {
  double worst = 0.0;
  double worst_sigma = 0.0;
  health.measured_on = {};
  for (std::size_t k = 0; k < estimate.observed; ++k) {
    const ObservedDirection& d = estimate.directions[k];
    const Vector3 registered = d.registered.normalized();
    note_axis(d.gyro, registered, health);
    const double angle = angle_between(d.gyro, registered);
    if (angle <= std::max(kOtherAxisDegrees, worst)) continue;
    worst = angle;
    worst_sigma = d.angle_sigma * kDegreesPerRadian;
  }
  set_row(health, ImuCheck::kGyroAxes, worst, worst_sigma);
}

void fill_mounting(const GyroAlignmentEstimate& estimate, ImuHealth& health) {
  double worst = 0.0;
  double worst_sigma = 0.0;
  for (std::size_t k = 0; k < estimate.observed; ++k) {
    const ObservedDirection& d = estimate.directions[k];
    const double angle = angle_between(d.gyro, d.registered.normalized());
    if (!d.strong || angle < worst) continue;
    worst = angle;
    worst_sigma = d.angle_sigma * kDegreesPerRadian;
  }
  set_row(health, ImuCheck::kGyroMounting, worst, worst_sigma);
}

}  // namespace

void fill_directions(const GyroAlignmentEstimate& estimate, ImuHealth& health) {
  if (estimate.observed == 0) {
    for (const ImuCheck check : {ImuCheck::kGyroAxes, ImuCheck::kGyroMounting, ImuCheck::kGyroScale})
      clear_row(health, check);
    return;
  }
  fill_axes(estimate, health);
  const ObservedDirection& strongest = estimate.directions[0];
  const double scale = 1.0 / strongest.registered.norm();
  // Small errors are separable only once the time offset is known: at the onset of a turn they look alike.
  if (estimate.time_offset_known || scale > kOtherUnit || scale * kOtherUnit < 1.0)
    set_row(health, ImuCheck::kGyroScale, scale, strongest.angle_sigma * scale);
  if (health[ImuCheck::kGyroAxes].state == ImuCheckState::kBad) {
    clear_row(health, ImuCheck::kGyroMounting);
  } else if (estimate.time_offset_known) {
    fill_mounting(estimate, health);
  }
}

namespace {

/// Only the uncorrected part of the time offset counts.
bool is_uncorrected(const ImuHealth& health) {
  const ImuDiagnosis& row = health[ImuCheck::kTimeOffset];
  return row.state == ImuCheckState::kBad &&
         std::abs(row.value - health.time_shift_ms) > row_of(ImuCheck::kTimeOffset).bad;
}

}  // namespace

ImuCheck find_obstacle(const ImuHealth& health) {
  for (const ImuCheck check : {ImuCheck::kGyroStuck, ImuCheck::kGyroAxes, ImuCheck::kGyroScale,
                               ImuCheck::kGyroMounting, ImuCheck::kTimeOffset, ImuCheck::kGyroNoise}) {
    if (check == ImuCheck::kTimeOffset ? is_uncorrected(health) : health[check].state == ImuCheckState::kBad)
      return check;
  }
  return ImuCheck::kCount;
}

}  // namespace nilio::core
