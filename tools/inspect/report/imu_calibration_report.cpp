#include "nilio/core/units.hpp"

#include "tools/common/text.hpp"
#include "tools/inspect/report/report.hpp"

#include <array>
#include <cmath>

namespace nilio::tools::inspect {

namespace {

constexpr std::array<const char*, 3> kAxes = {"x", "y", "z"};

/// Rounded to multiples of `step`, without negative zero.
double rounded(double value, double step) {
  const double result = std::round(value / step) * step;
  return result == 0.0 ? 0.0 : result;
}

std::string offset_reason(const ImuCalibration& c) {
  return format("the IMU's stamps are %.1f ms (+- %.1f) %s than the LiDAR's for the same instant",
                1e3 * std::abs(c.time_offset_s), 1e3 * c.time_offset_sigma_s,
                c.time_offset_s > 0.0 ? "later" : "earlier");
}

std::string rotation_reason(const ImuCalibration& c) {
  if (c.along_axes) return "the IMU's axes are permuted relative to the configuration";
  return format("best fit to gyro, gravity and accelerations; the configured mounting is %.1f deg off",
                c.fitted_angle * kDegreesPerRadian);
}

std::string scale_reason(const ScaleCorrection& scale, bool negated, const char* right, const char* wrong) {
  std::string text;
  if (scale.factor != 1.0 && scale.is_unit) {
    text = format("%s are read as %s: times %.6g", wrong, right, scale.factor);
  } else if (scale.factor != 1.0) {
    text = format("the values are too %s: times %.4g", scale.factor > 1.0 ? "small" : "large", scale.factor);
  }
  if (negated) text += std::string(text.empty() ? "" : "; ") + "the axis has the wrong sign";
  return text;
}

const char* gyro_unit(double factor) { return factor < 1.0 ? "deg/s" : "rad/s in deg/s"; }
const char* accel_unit(double factor) {
  return factor > 1.0 ? "g" : factor < 0.05 ? "milli-g" : "m/s^2 in g";
}

/// Scale factors of one sensor's axes.
struct AxisScales {
  const ScaleCorrection& scale;
  const std::array<bool, 3>& negated;
  const char* quantity;
  const char* right;
  const char* wrong;
};

void correct_scales(const AxisScales& scales, std::array<daemon::ImuAxisConfig, 3>& axes,
                    std::vector<CorrectedKey>& keys) {
  for (std::size_t i = 0; i < 3; ++i) {
    const double factor = scales.scale.factor * (scales.negated[i] ? -1.0 : 1.0);
    if (factor == 1.0) continue;
    axes[i].scale *= factor;
    keys.push_back({format("imu.%s_%s.scale", scales.quantity, kAxes[i]), format("%.7g", axes[i].scale),
                    scale_reason(scales.scale, scales.negated[i], scales.right, scales.wrong)});
  }
}

std::vector<CorrectedKey> correct(const ImuCalibration& c, daemon::ImuConfig& imu) {
  std::vector<CorrectedKey> keys;
  if (c.time_offset_matters) {
    imu.time_offset_ms = rounded(imu.time_offset_ms + 1e3 * c.time_offset_s, 0.1);
    keys.push_back({"imu.time_offset_ms", format("%.1f", imu.time_offset_ms), offset_reason(c)});
  }
  correct_scales({c.gyro, c.negate_gyro, "angular_velocity", "rad/s", gyro_unit(c.gyro.factor)},
                 imu.angular_velocity, keys);
  correct_scales({c.accel, c.negate_accel, "linear_acceleration", "m/s^2", accel_unit(c.accel.factor)},
                 imu.linear_acceleration, keys);
  const core::Vector3 rpy = roll_pitch_yaw(c.R_base_imu.toRotationMatrix()) * kDegreesPerRadian;
  std::vector<double> rounded_rpy;
  bool changed = false;
  for (Eigen::Index i = 0; i < 3; ++i) {
    rounded_rpy.push_back(rounded(rpy[i], 0.01));
    changed = changed || std::abs(rounded_rpy.back() -
                                  imu.extrinsic.rotation_rpy_deg[static_cast<std::size_t>(i)]) > 0.02;
  }
  if (c.orientation_changed && changed) {
    imu.extrinsic.rotation_rpy_deg = rounded_rpy;
    keys.push_back({"imu.extrinsic.rotation_rpy_deg", numbers_text(rounded_rpy), rotation_reason(c)});
  }
  return keys;
}

}  // namespace

std::vector<CorrectedKey> corrected_keys(const DriveFindings& drive) {
  daemon::ImuConfig imu = drive.config.imu;
  return correct(drive.calibration, imu);
}

daemon::Config corrected_config(const DriveFindings& drive) {
  daemon::Config config = drive.config;
  correct(drive.calibration, config.imu);
  return config;
}

std::string observed_text(const ImuCalibration& calibration) {
  constexpr std::array<const char*, 3> kNames = {"roll", "pitch", "yaw"};
  std::string text;
  for (std::size_t i = 0; i < 3; ++i) {
    const double sigma = calibration.rotation_sigma[i];
    text += format("%s%s ", i == 0 ? "" : ", ", kNames[i]);
    text += std::isfinite(sigma) ? format("+- %.1f deg", sigma * kDegreesPerRadian) : "not observed";
  }
  return text;
}

std::string numbers_text(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) text += format("%s%.6g", text.empty() ? "[" : ", ", number);
  return text + "]";
}

}  // namespace nilio::tools::inspect
