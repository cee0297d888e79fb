#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::core {

/// What is watched of an IMU. Units as unit_of() says.
enum class ImuCheck : std::uint8_t {
  kGyroAgreement,     ///< difference of gyro and registered rotation, root mean square of a second
  kGyroAxes,          ///< angle from an axis of base_link to the one its rotation is measured on
  kGyroMounting,      ///< angle between the gyro's and the registered axis of rotation
  kGyroScale,         ///< what the gyro reads for one degree of rotation
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
  /// That the value is held against at present (that of `bad` once it is bad).
  double threshold = 0.0;
  ImuCheckState state = ImuCheckState::kUnknown;
  /// The worst there has been.
  ImuCheckState worst_state = ImuCheckState::kUnknown;
  double worst_value = 0.0;
};

/// What the monitor has found out so far. Trivially copyable, for rings.
struct ImuHealth {
  std::array<ImuDiagnosis, kImuChecks> rows{};
  /// The gyro has shown that it predicts rotation at least as well as a constant rate does.
  bool trusted = false;
  /// Why it is not trusted, once it has been compared; kCount = nothing speaks against it.
  ImuCheck reason = ImuCheck::kCount;
  /// Times that trust was withdrawn.
  std::uint32_t demotions = 0;
  /// One standard deviation of the time offset, ms.
  double time_offset_sigma_ms = 0.0;
  /// What is subtracted from the IMU's stamps because of it, ms.
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
/// What a sound IMU shows: thresholds hold for the distance from it.
double normal_of(ImuCheck check);
const char* name_of(ImuCheckState state);
/// What the value probably means and what to do about it; empty while the row is ok or unknown.
std::string hint_for(ImuCheck check, const ImuHealth& health);

}  // namespace nilio::core
