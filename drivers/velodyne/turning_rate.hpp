#pragma once

#include "nilio/drivers/velodyne/model.hpp"

#include <cstdint>

namespace nilio::drivers {

/// Mean speed of rotation over the last one to two seconds, or since the start.
class TurningRate {
 public:
  /// `azimuth`: unwrapped, 0.01 degree.
  void add(std::int64_t time_ns, std::int64_t azimuth) {
    last_ = {time_ns, azimuth};
    if (!started_) {
      started_ = true;
      before_ = middle_ = last_;
    } else if (time_ns - middle_.time_ns >= kWindowNs) {
      before_ = middle_;
      middle_ = last_;
    }
  }

  /// Time and azimuth begin anew; the speed holds until the next steps.
  void restart() {
    const double speed = revolutions_per_minute();
    *this = TurningRate();
    previous_ = speed;
  }

  /// 0 = unknown.
  [[nodiscard]] double revolutions_per_minute() const {
    const std::int64_t time_ns = last_.time_ns - before_.time_ns;
    if (time_ns <= 0) return previous_;
    const double turns = static_cast<double>(last_.azimuth - before_.azimuth) / kAzimuthModulus;
    return turns * 60e9 / static_cast<double>(time_ns);
  }

 private:
  struct Mark {
    std::int64_t time_ns = 0;
    std::int64_t azimuth = 0;
  };
  static constexpr std::int64_t kWindowNs = 1'000'000'000;

  double previous_ = 0.0;
  bool started_ = false;
  Mark before_;
  Mark middle_;
  Mark last_;
};

}  // namespace nilio::drivers
