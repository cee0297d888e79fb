#pragma once

#include "core/src/estimation/motion_estimator.hpp"
#include "core/src/registration/ndt_icp.hpp"

#include <array>
#include <cstddef>
#include <span>
#include <vector>

namespace nilio::core {

/// Sweeps of a map before the scan that ends its beginning.
inline constexpr std::size_t kInitialSweeps = kInitialScans - 1;

/// Where a sweep is in the map, and the motion that deskews it.
struct PlacedSweep {
  SweepMotion motion;
  SE3 T_map_middle;
};

/// A motion of the vehicle since the first scan of a map, and the alignment of the last scan with the map
/// that earlier ones give with it.
struct InitialMotion {
  MotionEstimator::Hypothesis motion;  ///< of the last scan, before its update
  Alignment alignment;
  std::array<PlacedSweep, kInitialSweeps> earlier;
};

/// Hypotheses of the motion since the first scan of a map, and the scans since then. Two scans do not observe
/// the speed where few of their points do, and moving objects suggest another one: hypotheses are kept until
/// one is left. Memory is allocated at construction. Not thread-safe.
class InitialMotions {
 public:
  /// Speeds along the vehicle's axis; at rest first.
  static constexpr std::array<double, 8> kSpeeds = {0.0, 10.0, 20.0, 30.0, 40.0, 50.0, -10.0, -20.0};
  static constexpr double kSpeedStep = 10.0;

  explicit InitialMotions(std::size_t max_points);

  /// The first scan of a map.
  void begin(const std::vector<SweepPoint>& sweep, const SweepSpan& span);
  /// Places the first sweep for the motions that are added next.
  void place_first(const PlacedSweep& placed) { first_ = placed; }
  void add(const MotionEstimator::Hypothesis& motion, const Alignment& alignment);
  void replace(InitialMotion& found, const MotionEstimator::Hypothesis& motion, const Alignment& alignment);
  /// Drops all but one of the motions that end at the same place: that with which most points agree.
  void drop_equal();
  /// The first motion is that of a vehicle whose IMU says that it is stationary: it alone is kept, unless the
  /// map agrees much better with another one. Returns whether it is.
  bool keep_stationary();
  /// Drops motions out of family, where more points agree with another one and much better, and equal ones.
  /// The best becomes the first: that of most points; from the third scan on, with planes, that with most
  /// information along the vehicle's x axis, because the static scene agrees with the true speed.
  void keep_likely();
  void keep_first() { motions_.erase(motions_.begin() + 1, motions_.end()); }
  /// Drops this motion and those behind it, for which there was no time.
  void keep_before(const InitialMotion& end) {
    motions_.erase(motions_.begin() + (&end - motions_.data()), motions_.end());
  }
  /// The scan ends, for each motion with an update by its alignment; its sweep will be part of the map.
  void end_scan(const std::vector<SweepPoint>& sweep);

  /// Whether no other motion is left to compare with.
  [[nodiscard]] bool are_decided() const { return motions_.size() < 2; }
  [[nodiscard]] std::span<InitialMotion> motions() { return motions_; }
  [[nodiscard]] const SweepSpan& first_span() const { return first_span_; }
  /// Sweeps that ended, in order.
  [[nodiscard]] std::span<const std::vector<SweepPoint>> sweeps() const { return {sweeps_.data(), count_}; }

 private:
  std::array<std::vector<SweepPoint>, kInitialSweeps> sweeps_;
  std::size_t count_ = 0;
  SweepSpan first_span_;
  PlacedSweep first_;
  std::vector<InitialMotion> motions_;
};

}  // namespace nilio::core
