#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <cstddef>
#include <cstdint>

namespace nilio::tools::simulate {

/// What the sensor has of a GPS receiver.
enum class GpsReception : std::uint8_t {
  kLocked,    ///< pulse and time: the sensor's clock is the receiver's
  kNmeaOnly,  ///< time without a pulse: the sensor's clock runs by itself
  kNone,      ///< no receiver
};

struct SensorTimingConfig {
  std::uint64_t seed = 1;
  /// Instant of the trajectory's time 0, by the host's clock, which is right. Whole microseconds.
  core::Time start;
  /// Sensor's clock less the host's at the start; rounded to whole microseconds.
  core::Duration clock_offset;
  /// How much faster the sensor's clock runs, parts per million. Its oscillator times the firings too.
  double clock_drift_ppm = 0.0;
  /// Longest delay of a packet beyond the shortest; packets do not overtake one another.
  core::Duration network_jitter;
};

/// When a sensor fires, what its clock then says, and when a host receives the packet. Everything is a
/// function of the packet's index, so that packets may be made in any order. Immutable.
class SensorTiming {
 public:
  /// `sensor` is looked at only here.
  SensorTiming(const drivers::VelodyneSensor& sensor, const drivers::PacketLayout& layout,
               const SensorTimingConfig& config);

  /// What a packet's stamp says, in full; whole microseconds. For the first azimuth step.
  [[nodiscard]] core::Time sensor_clock(std::uint64_t packet) const;
  /// True time since the start that the time offsets of an azimuth step's entries are relative to.
  [[nodiscard]] core::Duration step_time(std::uint64_t packet, std::size_t step) const;
  /// True time of a packet's last firing since the start.
  [[nodiscard]] core::Duration last_firing(std::uint64_t packet) const;
  /// When the host stamps the packet: the last firing, transmission and jitter.
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
  /// How late a firing sequence may be: the mean of the random rests between them is in the period.
  std::int64_t rest_jitter_ns_ = 0;
  /// Last firing of an azimuth step after its time.
  std::int64_t last_offset_ns_ = 0;
};

/// From the last firing to the host's time stamp when nothing delays a packet.
inline constexpr core::Duration kTransmission{100'000};

}  // namespace nilio::tools::simulate
