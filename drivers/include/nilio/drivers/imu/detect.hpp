#pragma once

#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {

/// True for a mean norm of the specific force near gravity, m/s^2. Other devices with the identifiers of an
/// IMU fail this.
bool is_plausible_imu(double mean_acceleration_m_s2);

/// Finds the built-in IMU whose messages are on a bus, by decoding with every preset of six axes. One thread.
class ImuDetector {
 public:
  ImuDetector();
  void add(const CanFrame& frame);
  /// The plausible preset with most samples so far; unset without one.
  [[nodiscard]] std::optional<std::string> preset() const;
  /// Number of its samples.
  [[nodiscard]] std::uint64_t samples() const;

 private:
  struct Candidate {
    std::string name;
    ImuDecoder decoder;
    double acceleration_sum = 0.0;
  };
  [[nodiscard]] const Candidate* best() const;

  std::vector<Candidate> candidates_;
};

/// Reads the beginning of a recording: until a preset has some seconds of samples, or 200,000 frames.
std::optional<std::string> detect_imu_preset(FrameSource& frames);

}  // namespace nilio::drivers
