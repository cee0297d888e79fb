#pragma once

#include "drivers/velodyne/turning_rate.hpp"

#include <cstdint>

namespace nilio::drivers {

/// Decides where scans end; holds no points. docs/design/scan_cutting.md defines states, events and actions.
class ScanCutter {
 public:
  enum class State {
    kEmpty,
    kFilling,
    kBetween,  ///< the last scan is complete; the next one begins with the next step
  };
  enum class Action {
    kOpen,          ///< no scan is open: this step begins one
    kAppend,        ///< the step belongs to the open scan
    kCutAtAzimuth,  ///< the open scan is complete; this step begins the next one
    kCutByTime,     ///< the motor is stopped or too slow: the same, by time
    kCutByRoom,     ///< the scan's buffer is full: the same
  };

  /// `cut` in 0.01 degree. A scan lasts at most `longest_ns`.
  ScanCutter(int cut, std::int64_t longest_ns) : cut_(cut), longest_ns_(longest_ns) {}

  /// Action for the azimuth step at `time_ns`. `rate` is the advance per `azimuth_period_ns` in 0.01 degree;
  /// `room`: the open scan has room for the step; `may_cut`: a complete scan can be delivered. Then call
  /// open(), except for kAppend.
  Action evaluate(std::uint16_t azimuth, std::int64_t time_ns, float rate, std::int64_t azimuth_period_ns,
                  bool room, bool may_cut);
  /// The last evaluated step begins a scan.
  void open();
  /// True if the next step will pass the cut, so that the open scan is complete.
  [[nodiscard]] bool next_step_cuts(float rate) const;
  /// The open scan was ended because of next_step_cuts().
  void end_early() { state_ = State::kBetween; }
  /// Time jump or end of the input: the open scan ends, azimuth and time are reset.
  void restart();
  [[nodiscard]] State state() const { return state_; }
  [[nodiscard]] std::int64_t start_ns() const { return start_ns_; }
  /// Mean over one to two seconds; 0 = unknown.
  [[nodiscard]] double revolutions_per_minute() const { return turning_.revolutions_per_minute(); }
  [[nodiscard]] bool has_azimuth() const { return has_azimuth_; }
  [[nodiscard]] std::uint16_t last_azimuth() const { return last_azimuth_; }

 private:
  void track(std::uint16_t azimuth, std::int64_t time_ns, float rate, std::int64_t azimuth_period_ns);
  [[nodiscard]] std::int64_t turns_between(int difference, std::int64_t time_ns, float rate,
                                           std::int64_t azimuth_period_ns) const;
  [[nodiscard]] std::int64_t next_cut() const { return (scan_revolution_ + 1) * kAzimuthModulus; }

  int cut_;
  std::int64_t longest_ns_;
  State state_ = State::kEmpty;
  bool has_azimuth_ = false;
  std::uint16_t last_azimuth_ = 0;
  std::int64_t last_step_ns_ = 0;
  /// Azimuth of the last step, unwrapped from the cut over all revolutions.
  std::int64_t unwrapped_ = 0;
  std::int64_t scan_revolution_ = 0;
  std::int64_t start_ns_ = 0;
  TurningRate turning_;
};

}  // namespace nilio::drivers
