#pragma once

#include <cstdint>

namespace nilio::drivers {

/// Decides where scans end; holds no points. The states, events and actions are those of SCAN_CUTTING.md.
class ScanCutter {
 public:
  enum class State {
    kEmpty,
    kFilling,
    kBetween,  ///< the last scan is complete, the next one begins with the next step
  };
  enum class Action {
    kOpen,          ///< no scan is open: this step begins one
    kAppend,        ///< the step belongs to the open scan
    kCutAtAzimuth,  ///< the open scan is complete; this step begins the next one
    kCutByTime,     ///< the motor stands or turns too slowly: the same, by time
    kCutByRoom,     ///< the scan is as large as a scan can be: the same
  };

  /// `cut` in 0.01 degree. A scan lasts at most `longest_ns`.
  ScanCutter(int cut, std::int64_t longest_ns) : cut_(cut), longest_ns_(longest_ns) {}

  /// What to do with the azimuth step at `time_ns`; `rate` is the advance per `azimuth_period_ns` in 0.01
  /// degree. `room` says whether the open scan has room for it; `may_cut` whether a complete scan could be
  /// taken over. Follow with open(), unless it is to be appended, and append().
  Action evaluate(std::uint16_t azimuth, std::int64_t time_ns, float rate, std::int64_t azimuth_period_ns,
                  bool room, bool may_cut);
  /// The step judged last begins a scan.
  void open();
  /// Whether the step after the last one will pass the cut: nothing more will come of the open scan.
  [[nodiscard]] bool next_step_cuts(float rate) const;
  /// The open scan was ended for that.
  void end_early() { state_ = State::kBetween; }
  /// The step judged last belongs to the open scan.
  void append() { covered_ += advance_; }
  /// A time jump, or the end of the input: the open scan is over, azimuth and time start anew.
  void restart();
  [[nodiscard]] State state() const { return state_; }
  [[nodiscard]] std::int64_t start_ns() const { return start_ns_; }
  /// Azimuth covered by the open scan, gaps left out, 0.01 degree.
  [[nodiscard]] double covered() const { return covered_; }
  /// A late step of the open scan.
  void add_covered(float rate) { covered_ += static_cast<double>(rate); }
  [[nodiscard]] bool has_azimuth() const { return has_azimuth_; }
  [[nodiscard]] std::uint16_t last_azimuth() const { return last_azimuth_; }

 private:
  void track(std::uint16_t azimuth, std::int64_t time_ns, float rate, std::int64_t azimuth_period_ns);

  int cut_;
  std::int64_t longest_ns_;
  State state_ = State::kEmpty;
  bool has_azimuth_ = false;
  std::uint16_t last_azimuth_ = 0;
  std::int64_t last_step_ns_ = 0;
  /// Azimuth of the last step, counted on from the cut over all revolutions.
  std::int64_t unwrapped_ = 0;
  std::int64_t scan_revolution_ = 0;
  std::int64_t start_ns_ = 0;
  /// The last step's share of the coverage.
  double advance_ = 0.0;
  double covered_ = 0.0;
};

}  // namespace nilio::drivers
