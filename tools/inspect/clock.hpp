#pragma once

#include "nilio/core/time.hpp"

#include <cstdint>
#include <optional>

namespace nilio::tools::inspect {

/// A sensor's clock (microseconds past the hour) against the stamps of the capture.
struct ClockFindings {
  /// Sensor minus capture at the start, modulo one hour: -1800 to 1800 s.
  double offset_s = 0.0;
  /// How fast the sensor's clock runs away from the capture's; only from recordings of 10 s.
  std::optional<double> drift_ppm;
  /// Closer than the 200 ms within which niliod takes sensor time for synchronised.
  bool agrees = false;
};

/// A packet is only ever stamped late, so of each second the least difference counts; the drift is that of
/// the line through those. After a step of more than half a second (a clock was set) it begins anew.
class ClockComparison {
 public:
  /// Of the next data packet; `duration_ns` from its time stamp to its sending.
  void add(std::uint32_t timestamp_us, core::Time stamp, std::int64_t duration_ns);
  /// Nothing before the first packet.
  [[nodiscard]] std::optional<ClockFindings> findings() const;

 private:
  void close_window();

  bool open_ = false;
  bool restarted_ = false;
  std::int64_t first_ns_ = 0;        ///< difference capture minus sensor of the first packet
  std::int64_t first_least_ns_ = 0;  ///< least of the first window
  std::int64_t start_ns_ = 0;        ///< capture stamp at which the line begins
  std::int64_t window_start_ns_ = 0;
  std::int64_t least_ns_ = 0;
  std::int64_t least_at_ns_ = 0;
  /// Sums of the closed windows for a straight line, seconds from `start_ns_` and `first_ns_`.
  double windows_ = 0.0;
  double sum_t_ = 0.0;
  double sum_d_ = 0.0;
  double sum_tt_ = 0.0;
  double sum_td_ = 0.0;
};

}  // namespace nilio::tools::inspect
