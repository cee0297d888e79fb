#pragma once

#include "nilio/core/imu_buffer.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
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

struct ImuMonitorConfig {
  /// Where the IMU is on base_link, m.
  Vector3 imu_position = Vector3::Zero();
  Duration max_gap = Duration::from_milliseconds(150.0);
};

/// Motion of base_link between two registered poses.
struct RegisteredMotion {
  Time from;
  Time to;
  SE3 T_odom_from;
  SE3 T_odom_to;

  [[nodiscard]] double seconds() const { return (to - from).seconds(); }
  /// Mean angular velocity in axes of base_link at `from`, rad/s.
  [[nodiscard]] Vector3 mean_rate() const {
    return so3_log(T_odom_from.rotation.conjugate() * T_odom_to.rotation) / seconds();
  }
};

/// Judges an IMU by the motion that the LiDAR registers: whether it may be used, and what is wrong with it.
/// Everything is a sum with fading memory, so memory is bounded and a scan costs the same at any time; what
/// comes out depends on the data alone. Not thread-safe.
class ImuMonitor {
 public:
  explicit ImuMonitor(const ImuMonitorConfig& config);
  ImuMonitor(ImuMonitor&&) noexcept;
  ImuMonitor& operator=(ImuMonitor&&) noexcept;
  ImuMonitor(const ImuMonitor&) = delete;
  ImuMonitor& operator=(const ImuMonitor&) = delete;
  ~ImuMonitor();

  /// Each sample that the buffer took, in the IMU's own axes and with its own stamp.
  void add(const ImuSample& sample);
  /// To be subtracted from the IMU's stamps: the time offset, once it is known. What is left of it shows in
  /// the next minute of turning.
  [[nodiscard]] Duration time_shift() const;

  /// Whether the gyro may be used for the motion in [from, to]: it is trusted, and neither stuck nor clipped
  /// there.
  [[nodiscard]] bool usable(Time from, Time to) const;
  /// Whether the accelerometer may be used: gravity and the gyro say that it is mounted as configured, and it
  /// is neither stuck nor has it clipped since.
  [[nodiscard]] bool force_usable(Time since) const;
  /// Whether the registered motion contradicts the gyro so plainly that this scan had better be registered
  /// without it.
  [[nodiscard]] bool contradicts(const ImuBuffer& imu, const Vector3& gyro_bias,
                                 const RegisteredMotion& motion) const;
  /// Withdraws trust because of a contradiction.
  void demote();
  /// The rate of the last registered motion, rad/s: what a constant rate would predict from.
  [[nodiscard]] const Vector3& registered_rate() const;

  /// Each scan whose registration was accepted; `gyro_bias` is what the user of the gyro subtracts. True when
  /// time_shift() has changed, so that the samples in `imu` have stamps of before and had better go.
  bool observe(const ImuBuffer& imu, const Vector3& gyro_bias, const RegisteredMotion& motion);
  /// A scan whose pose is no measurement.
  void skip();

  [[nodiscard]] const ImuHealth& health() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace nilio::core
