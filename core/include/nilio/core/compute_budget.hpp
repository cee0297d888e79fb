#pragma once

#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::core {

/// Limit on the time of a scan.
enum class BudgetMode : std::uint8_t {
  kOff,   ///< none
  kWall,  ///< a clock: results depend on the computer and its load
  kOps,   ///< counted work at nominal costs: the same results everywhere
};

/// Kinds of counted work, in units of one point: in preparation (range gate, voxel filter, deskewing,
/// selection) a point of the scan, in registration a point in one iteration. Finishing counts scans.
enum class WorkKind : std::uint8_t { kPrepare, kNdt, kIcp, kFinish, kCount };
inline constexpr std::size_t kWorkKindCount = static_cast<std::size_t>(WorkKind::kCount);

/// Degradation of a registration to keep the budget, from none to complete.
enum class DegradationLevel : std::uint8_t {
  kFull,
  kFewerPoints,     ///< fewer points of the scan, or fewer of them in the registration
  kIcpOnly,         ///< NDT was due but skipped
  kNdtOnly,         ///< no time for ICP after NDT
  kPredictionOnly,  ///< no time for any iteration
  kCount
};
inline constexpr std::size_t kDegradationLevels = static_cast<std::size_t>(DegradationLevel::kCount);
/// "full", "fewer_points", ...
const char* name_of(BudgetMode mode);
const char* name_of(DegradationLevel degradation_level);

struct BudgetConfig {
  BudgetMode mode = BudgetMode::kOff;
  /// From the arrival of the scan's last packet to its pose.
  Duration budget = Duration::from_milliseconds(50.0);
};

/// All clock-dependent decisions of one scan; replaying them repeats its registration bit for bit.
struct BudgetDecisions {
  static constexpr std::size_t kMaxCounts = 4;
  static constexpr std::size_t kMaxStops = 24;
  /// Chosen numbers of points, in order; the last one serves later choices.
  std::array<std::uint32_t, kMaxCounts> counts{};
  /// Indices of the queries "time for another iteration?" that were denied.
  std::array<std::uint16_t, kMaxStops> stops{};
  std::uint8_t count_size = 0;
  std::uint8_t stop_size = 0;
};

/// Compute budget of a scan. Chooses the number of points before work starts, from measured costs, and checks
/// before each iteration whether another one fits: the deadline is missed by a prediction error at most, not
/// by an iteration. In ops mode time is the nominal cost of the work done. Not thread-safe; does not
/// allocate.
class ComputeBudget {
 public:
  using ClockFunction = std::int64_t (*)();

  ComputeBudget(const BudgetConfig& config, ClockFunction clock);

  /// Begins a scan whose last packet arrived at `released_ns` by the clock, 0 = now, and that has to be done
  /// after `recovery` if that is longer than the configured budget. An exempt scan is not limited, but that
  /// it begins no hypothesis after `recovery`, and does not update the cost estimates.
  void begin_scan(std::int64_t released_ns, bool exempt, Duration recovery = {});
  /// Begins a scan that repeats recorded decisions.
  void begin_scan(const BudgetDecisions& decisions, bool exempt);

  /// Number of points of the scan to visit, at most `most`; 0 if too few fit.
  std::size_t choose_scan_points(std::size_t most);
  /// Number of points to register, at most `most`; 0 if too few fit. With `coarse`, NDT takes its share of
  /// the time first.
  std::size_t choose_registration_points(std::size_t most, bool coarse);
  /// Whether there is time for that much work.
  bool allows(WorkKind work, std::size_t units);
  /// Whether there is time to begin another hypothesis of an exempt scan.
  bool allows_hypothesis();
  /// Records the work done since the last call, or since the scan began.
  void record(WorkKind work, std::size_t units);
  /// Ends the scan after its pose was published; `iterations` of ICP were run.
  void finish_scan(int iterations);

  [[nodiscard]] BudgetMode mode() const { return config_.mode; }
  [[nodiscard]] std::int64_t now_ns() const;
  /// Lateness of a pose published now (ops mode: once the scan is finished) against the deadline; negative =
  /// early.
  [[nodiscard]] std::int64_t overshoot_ns() const;
  [[nodiscard]] Duration budget() const { return config_.budget; }
  [[nodiscard]] const BudgetDecisions& decisions() const { return decisions_; }
  /// Whether work was cut from this scan.
  [[nodiscard]] bool was_short() const { return short_ || decisions_.stop_size > 0; }
  /// Total units of work, by kind.
  [[nodiscard]] const std::array<std::uint64_t, kWorkKindCount>& work_done() const { return work_done_; }
  /// Estimated cost of an ICP iteration with the number of points chosen last.
  [[nodiscard]] std::int64_t iteration_ns() const;
  /// Estimated cost of one unit, beside the fixed cost of each piece of work.
  [[nodiscard]] double cost_ns(WorkKind work) const { return cost_ns_[static_cast<std::size_t>(work)]; }

 private:
  enum class Answers : std::uint8_t { kUnlimited, kDecided, kRepeated };

  void begin(Answers answers, bool exempt, std::int64_t begin_ns, std::int64_t deadline_ns);
  /// Whether the amount of work is.
  [[nodiscard]] bool is_limited() const { return !exempt_ && answers_ != Answers::kUnlimited; }
  bool decide(bool is_in_time);
  std::size_t choose(WorkKind work, std::size_t rounds, std::int64_t end_ns, std::size_t least,
                     std::size_t most);
  [[nodiscard]] std::size_t units_within(WorkKind work, std::int64_t end_ns, std::size_t rounds,
                                         std::size_t most) const;
  std::size_t keep_choice(std::size_t chosen);
  [[nodiscard]] static double cost_units(WorkKind work, std::size_t units);
  [[nodiscard]] std::int64_t end_of(WorkKind work) const;
  [[nodiscard]] std::int64_t predicted_ns(WorkKind work, std::size_t units) const;
  void update(WorkKind work, double sample_ns);
  void mark_lap();

  BudgetConfig config_;
  ClockFunction clock_;
  Answers answers_ = Answers::kUnlimited;
  bool exempt_ = false;
  std::int64_t counted_ns_ = 0;
  std::int64_t begin_ns_ = 0;
  /// By the clock, or by counted work since the start of the scan; the largest value if unlimited.
  std::int64_t deadline_ns_ = 0;
  std::int64_t lap_ns_ = 0;
  std::size_t registration_points_ = 0;
  bool coarse_ = false;
  bool short_ = false;
  std::uint16_t questions_ = 0;
  std::uint8_t choices_ = 0;
  BudgetDecisions decisions_;
  std::array<double, kWorkKindCount> cost_ns_;
  std::array<std::uint64_t, kWorkKindCount> work_done_{};
  double iterations_ = 6.0;  ///< of ICP that a scan needs, slowly averaged
};

}  // namespace nilio::core
