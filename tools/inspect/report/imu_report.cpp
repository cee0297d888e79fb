#include "tools/common/text.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::tools::inspect {

namespace {

using core::ImuCheck;
using core::ImuCheckState;
using core::ImuDiagnosis;
using core::ImuHealth;

std::string imu_row(const char* name, const std::string& value) {
  return format("  %-16s %s\n", name, value.c_str());
}

/// Four digits.
std::string number_text(double value) {
  const double size = std::abs(value);
  return format(size < 9.9995 ? "%.3f" : size < 99.995 ? "%.2f" : "%.1f", value);
}

const char* state_text(ImuCheckState state) {
  switch (state) {
    case ImuCheckState::kOk:
      return "ok";
    case ImuCheckState::kWarn:
      return "WARN";
    case ImuCheckState::kBad:
      return "BAD";
    case ImuCheckState::kUnknown:
      break;
  }
  return "-";
}

/// Clipping has no threshold.
bool is_flag(ImuCheck check) {
  return check == ImuCheck::kGyroSaturation || check == ImuCheck::kAccelSaturation;
}

std::string limit_text(ImuCheck check, const ImuDiagnosis& diagnosis) {
  if (is_flag(check) || diagnosis.state == ImuCheckState::kUnknown) return "";
  const double normal = core::normal_of(check);
  return normal == 0.0 ? format("%.4g", diagnosis.threshold)
                       : format("%.4g +- %.4g", normal, diagnosis.threshold);
}

std::string value_text(ImuCheck check, const ImuDiagnosis& diagnosis) {
  if (diagnosis.state == ImuCheckState::kUnknown) return "-";
  return is_flag(check) && diagnosis.value == 0.0 ? "none" : number_text(diagnosis.value);
}

/// Empty if it equals the value and state.
std::string worst_text(const ImuDiagnosis& diagnosis) {
  if (diagnosis.worst_state < ImuCheckState::kWarn) return "";
  if (diagnosis.worst_state == diagnosis.state && diagnosis.worst_value == diagnosis.value) return "";
  return format("%s %s", number_text(diagnosis.worst_value).c_str(), state_text(diagnosis.worst_state));
}

std::string check_table(const ImuHealth& health) {
  std::string text = without_trailing_space(
      format("\n  %-18s %10s  %-8s  %-13s %-5s  %s", "check", "value", "unit", "limit", "state", "worst"));
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    const ImuDiagnosis& d = health[check];
    text += without_trailing_space(format(
        "  %-18s %10s  %-8s  %-13s %-5s  %s", core::name_of(check), value_text(check, d).c_str(),
        core::unit_of(check), limit_text(check, d).c_str(), state_text(d.state), worst_text(d).c_str()));
  }
  return text + "\n";
}

std::string hints(const ImuHealth& health) {
  std::string text;
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const auto check = static_cast<ImuCheck>(i);
    const std::string hint = core::hint_for(check, health);
    if (!hint.empty()) text += format("  %-18s %s\n", core::name_of(check), hint.c_str());
  }
  return text.empty() ? "" : text + "\n";
}

std::string time_offset_text(const ImuCalibration& c) {
  if (!c.time_offset_known)
    return "unknown: the drive has too few turns, or the gyroscope does not follow them";
  return format("%+.1f ms +- %.1f: IMU stamp minus LiDAR stamp of the same time; + is late",
                1e3 * c.time_offset_s, 1e3 * c.time_offset_sigma_s);
}

std::string use_text(const DriveFindings& drive) {
  std::string text =
      format("%.1f s, %llu poses", drive.seconds, static_cast<unsigned long long>(drive.poses));
  if (drive.cut_short) text += ", then no more (--imu-seconds)";
  if (drive.predicted > 0)
    text +=
        format("; %llu of them predicted, not registered", static_cast<unsigned long long>(drive.predicted));
  text += format("; the gyroscope was used for %llu", static_cast<unsigned long long>(drive.with_gyro));
  const ImuHealth& health = drive.health;
  if (!health.trusted && health.reason != ImuCheck::kCount)
    text += format(", refused because of %s", core::name_of(health.reason));
  return text;
}

std::string configured_text(const DriveFindings& drive) {
  const daemon::ImuConfig& imu = drive.config.imu;
  return format(
      "%s, rotation_rpy_deg %s, from %s", printable_text(imu.dbc.empty() ? imu.preset : imu.dbc).c_str(),
      numbers_text(imu.extrinsic.rotation_rpy_deg).c_str(),
      drive.config_path.empty() ? "the defaults and the CAN log" : printable_text(drive.config_path).c_str());
}

std::string correction_text(const DriveFindings& drive) {
  const ImuCalibration& c = drive.calibration;
  const std::vector<CorrectedKey> keys = corrected_keys(drive);
  std::string text;
  if (c.axes_disagree) {
    text += imu_row("correction",
                    "gyroscope and accelerometer result in different axes, which no rotation corrects: check "
                    "which signals are mapped to which axis");
  } else if (keys.empty()) {
    text += imu_row("correction", "none: the drive agrees with the configuration");
  }
  if (keys.empty()) return text;
  std::size_t width = 0;
  for (const CorrectedKey& key : keys) width = std::max(width, key.path.size() + key.value.size() + 2);
  text += imu_row("correction", "put this into the configuration (--write-config does):");
  for (const CorrectedKey& key : keys) {
    const std::string line = key.path + ": " + key.value;
    text += format("    %-*s  # %s\n", static_cast<int>(width), line.c_str(), key.why.c_str());
  }
  if (drive.with_gyro_corrected)
    text += imu_row("with it", format("the gyroscope is used for %llu of %llu poses",
                                      static_cast<unsigned long long>(*drive.with_gyro_corrected),
                                      static_cast<unsigned long long>(drive.poses)));
  return text;
}

std::string observed_row(const ImuCalibration& c) {
  const bool any = std::any_of(c.rotation_sigma.begin(), c.rotation_sigma.end(),
                               [](double sigma) { return std::isfinite(sigma); });
  if (!any) return "no axis of the mounting: too little steady driving and turning";
  std::string text = observed_text(c);
  if (!c.mirror_known)
    text +=
        "; too little braking and cornering to distinguish a mirror image (one wrong sign) from a rotation";
  return text;
}

}  // namespace

std::string imu_check_report(const DriveFindings& drive) {
  return "IMU against LiDAR\n" + imu_row("configured", configured_text(drive)) +
         imu_row("drive", use_text(drive)) + check_table(drive.health) + hints(drive.health) +
         imu_row("time offset", time_offset_text(drive.calibration)) +
         imu_row("mounting", observed_row(drive.calibration)) + correction_text(drive);
}

}  // namespace nilio::tools::inspect
