#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <cstddef>
#include <cstdint>

namespace nilio::tools::simulate {

/// GPS receiver of the sensor.
enum class GpsReception : std::uint8_t {
  kLocked,    ///< pulse and time: the sensor's clock is the receiver's
  kNmeaOnly,  ///< time without a pulse: the sensor's clock runs by itself
  kNone,      ///< no receiver
};

struct SensorTimingConfig {
  std::uint64_t seed = 1;
  /// Host time of the trajectory's time 0; the host's clock is exact. Whole microseconds.
  core::Time start;
  /// Sensor clock minus host clock at the start; rounded to whole microseconds.
  core::Duration clock_offset;
  /// Rate error of the sensor's clock, parts per million; positive = fast. Its oscillator also times the
  /// firings.
  double clock_drift_ppm = 0.0;
  /// Maximum additional delay of a packet; packets do not overtake one another.
  core::Duration network_jitter;
};

/// Firing times of a sensor, the readings of its clock, and the host's receive times. All are functions of
/// the packet's index, so that packets may be made in any order. Immutable.
class SensorTiming {
 public:
  /// `sensor` is used only in the constructor.
  SensorTiming(const drivers::VelodyneSensor& sensor, const drivers::PacketLayout& layout,
               const SensorTimingConfig& config);

  /// Time stamp of a packet in full; whole microseconds. For the first azimuth step.
  [[nodiscard]] core::Time sensor_clock(std::uint64_t packet) const;
  /// True time since the start to which the time offsets of an azimuth step's entries refer.
  [[nodiscard]] core::Duration step_time(std::uint64_t packet, std::size_t step) const;
  /// True time of a packet's last firing since the start.
  [[nodiscard]] core::Duration last_firing(std::uint64_t packet) const;
  /// Receive time of a packet: the last firing, transmission and jitter.
  [[nodiscard]] core::Time received(std::uint64_t packet) const;
  /// The sensor's clock at a true time since the start.
  [[nodiscard]] core::Time sensor_clock_at(core::Duration time) const;
  /// Mean true time from one packet to the next.
  [[nodiscard]] core::Duration packet_period() const;
  [[nodiscard]] const SensorTimingConfig& config() const { return config_; }

 private:
  [[nodiscard]] std::int64_t sequence_ns(std::uint64_t sequence) const;
  [[nodiscard]] std::int64_t to_true_ns(std::int64_t sensor_ns) const;

  SensorTimingConfig config_;
  std::size_t steps_;
  std::int64_t step_period_ns_;
  /// Maximum delay of a firing sequence; the mean of the random rests between them is part of the period.
  std::int64_t rest_jitter_ns_ = 0;
  /// Last firing of an azimuth step after its time.
  std::int64_t last_offset_ns_ = 0;
};

/// Microseconds past the hour, as packets have them.
std::uint32_t timestamp_us(core::Time sensor_clock);

/// From the last firing to the host's time stamp without additional delay.
inline constexpr core::Duration kTransmission{100'000};

}  // namespace nilio::tools::simulate
