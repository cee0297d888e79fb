#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/packet.hpp"

#include "tools/common/statistics.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::inspect {

/// Contents of the messages of one IMU preset on one CAN interface.
struct ImuFindings {
  std::string preset;
  std::string interface_name;
  drivers::ImuDecoderStats stats;
  core::Time first;
  core::Time last;
  Spread interval_s;
  /// Norm of the specific force, m/s^2.
  Spread acceleration_m_s2;
  /// rad/s and m/s^2 by axis.
  std::array<Spread, 3> angular_velocity;
  std::array<Spread, 3> linear_acceleration;
  /// Stationary seconds and the means of the axes in them: gyro bias, and gravity.
  std::uint64_t still_seconds = 0;
  std::array<Spread, 3> still_angular_velocity;
  std::array<Spread, 3> still_linear_acceleration;

  /// The norm is near gravity; other devices with the same identifiers fail this.
  [[nodiscard]] bool plausible() const;
  [[nodiscard]] double rate_hz() const;
  /// Angle between the mean acceleration (of stationary seconds if there are any) and z; unset without
  /// samples.
  [[nodiscard]] std::optional<double> tilt_deg() const;
};

/// Decodes the frames of one interface with one preset, or takes samples. One thread.
class ImuInspector {
 public:
  static core::Result<ImuInspector> create(const std::string& preset, const std::string& interface_name);
  /// For the samples of an HDL-32E, whose gyros' zero offsets reach 30 degrees a second.
  static ImuInspector of_hdl32e();

  void add(const drivers::CanFrame& frame);
  void add(const core::ImuSample& sample);
  /// At the end of the log, once.
  ImuFindings finish();

 private:
  ImuInspector() = default;
  void close_window();

  /// About a second of samples.
  struct Window {
    core::Time start;
    std::array<Spread, 3> angular_velocity;
    std::array<Spread, 3> linear_acceleration;
  };

  std::optional<drivers::ImuDecoder> decoder_;
  /// Maximum mean rate of a stationary axis, rad/s.
  double largest_bias_ = 0.05;
  ImuFindings findings_;
  Window window_;
};

}  // namespace nilio::tools::inspect
