#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>
#include <optional>

namespace nilio::tools::inspect {

/// A sensor's clock (microseconds past the hour) compared with the stamps of the capture.
struct ClockFindings {
  /// Sensor minus capture at the start, modulo one hour: -1800 to 1800 s.
  double offset_s = 0.0;
  /// Rate of the sensor's clock relative to the capture's; only from recordings of 10 s.
  std::optional<double> drift_ppm;
  /// The offset is below 200 ms, the limit of niliod for synchronised sensor time.
  bool agrees = false;
};

/// Compares the clocks of sensor and capture. Receive delays are positive, so that the minimum difference of
/// each second counts; the drift is the slope of the line through the minima. After a step of more than half
/// a second (a clock was set) the line starts again.
class ClockComparison {
 public:
  /// Adds the next data packet; `duration_ns` from its time stamp to its transmission.
  void add(std::uint32_t timestamp_us, core::Time stamp, std::int64_t duration_ns);
  /// Unset before the first packet.
  [[nodiscard]] std::optional<ClockFindings> findings() const;

 private:
  void close_window();

  bool open_ = false;
  bool restarted_ = false;
  std::int64_t first_ns_ = 0;          ///< difference capture minus sensor of the first packet
  std::int64_t first_minimum_ns_ = 0;  ///< minimum of the first window
  std::int64_t start_ns_ = 0;          ///< capture stamp at which the line begins
  std::int64_t window_start_ns_ = 0;
  std::int64_t minimum_ns_ = 0;
  std::int64_t minimum_at_ns_ = 0;
  /// Sums of the closed windows for the line fit, seconds from `start_ns_` and `first_ns_`.
  double windows_ = 0.0;
  double sum_t_ = 0.0;
  double sum_d_ = 0.0;
  double sum_tt_ = 0.0;
  double sum_td_ = 0.0;
};

}  // namespace nilio::tools::inspect
