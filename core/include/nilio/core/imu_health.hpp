#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::core {

/// Checks of an IMU; units as given by unit_of().
enum class ImuCheck : std::uint8_t {
  kGyroAgreement,     ///< difference of gyro and registered rotation, root mean square of a second
  kGyroAxes,          ///< angle from an axis of base_link to the one its rotation is measured on
  kGyroMounting,      ///< angle between the gyro's and the registered axis of rotation
  kGyroScale,         ///< gyro reading for one degree of rotation
  kGyroBias,          ///< largest of the three
  kGyroNoise,         ///< from sample to sample
  kGyroSaturation,    ///< full scale at which it clips
  kGyroStuck,         ///< time without a change of any axis
  kGravityMagnitude,  ///< specific force at steady speed
  kGravityDirection,  ///< between the specific force at steady speed and base_link's z
  kAccelMounting,     ///< rotation that makes specific force and registered acceleration agree
  kAccelVibration,    ///< from sample to sample
  kAccelSaturation,   ///< full scale at which it clips
  kAccelStuck,        ///< time without a change of any axis
  kTimeOffset,        ///< IMU stamps less LiDAR stamps of the same instant
  kSampleLoss,        ///< against the usual interval of samples
  kSampleGap,         ///< the longest of the last seconds
  kCount
};
inline constexpr std::size_t kImuChecks = static_cast<std::size_t>(ImuCheck::kCount);

enum class ImuCheckState : std::uint8_t { kUnknown, kOk, kWarn, kBad };

/// One row of the table of diagnoses.
struct ImuDiagnosis {
  double value = 0.0;
  /// Threshold in force (that of `bad` once the row is bad).
  double threshold = 0.0;
  ImuCheckState state = ImuCheckState::kUnknown;
  /// Worst state so far, and its value.
  ImuCheckState worst_state = ImuCheckState::kUnknown;
  double worst_value = 0.0;
};

/// Results of the IMU monitor so far. Trivially copyable, for rings.
struct ImuHealth {
  std::array<ImuDiagnosis, kImuChecks> rows{};
  /// The gyro predicts rotation at least as well as a constant rate.
  bool trusted = false;
  /// Why it is not, once compared; kCount = no check is against it.
  ImuCheck reason = ImuCheck::kCount;
  /// Number of rejections.
  std::uint32_t demotions = 0;
  /// One standard deviation of the time offset, ms.
  double time_offset_sigma_ms = 0.0;
  /// Time shift subtracted from the IMU's stamps, ms.
  double time_shift_ms = 0.0;
  /// For kGyroAxes: 1 to 3 for x to z, negative for the opposite direction; 0 = not observed. Rotation
  /// about axis i of base_link is measured on `measured_on[i]`.
  std::array<std::int8_t, 3> measured_on{};

  [[nodiscard]] const ImuDiagnosis& operator[](ImuCheck check) const {
    return rows[static_cast<std::size_t>(check)];
  }
};

/// "gyro_axes", "deg", "ok", as logs and tables print them.
const char* name_of(ImuCheck check);
const char* unit_of(ImuCheck check);
/// Value of a sound IMU: thresholds apply to the distance from it.
double normal_of(ImuCheck check);
const char* name_of(ImuCheckState state);
/// Probable cause of the value and remedy; empty while the row is ok or unknown.
std::string hint_for(ImuCheck check, const ImuHealth& health);

/// Distances from normal_of() above which a check warns and is bad; 0 for one that is bad at once.
struct ImuCheckLimits {
  double warn = 0.0;
  double bad = 0.0;
};
ImuCheckLimits limits_of(ImuCheck check);

}  // namespace nilio::core
