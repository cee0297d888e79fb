#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::drivers {

/// Fits a sensor's clock to the host's: offset and drift.
///
/// A packet can only be received late, so the true offset is the lower envelope of host minus sensor time
/// (Moon, Skelly, Towsley: Estimation and removal of clock skew from network delay measurements, INFOCOM
/// 1999). The minimum difference of every second is kept for about a minute; the fit is the line below those
/// points with the smallest mean distance to them. All times in ns of the sensor's time line.
class ClockFit {
 public:
  void restart() { *this = ClockFit(); }
  /// `difference_ns` = host minus sensor time.
  void observe(std::int64_t sensor_ns, std::int64_t difference_ns);
  [[nodiscard]] bool empty() const { return !window_open_ && count_ == 0; }
  /// Offset to add to the sensor's time `sensor_ns`.
  [[nodiscard]] std::int64_t offset_at(std::int64_t sensor_ns) const;
  /// Change of the offset per second of sensor time.
  [[nodiscard]] double drift() const { return drift_; }

 private:
  struct Sample {
    std::int64_t sensor_ns = 0;
    std::int64_t difference_ns = 0;
  };
  static constexpr std::size_t kWindows = 64;

  void close_window();
  void fit();

  std::array<Sample, kWindows> samples_{};  ///< ring
  std::size_t count_ = 0;
  std::size_t next_ = 0;
  bool window_open_ = false;
  std::int64_t window_start_ns_ = 0;
  Sample least_;  ///< minimum of the open window
  Sample anchor_;
  double drift_ = 0.0;
};

}  // namespace nilio::drivers
