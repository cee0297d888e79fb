#pragma once

#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>
#include <cstdint>

namespace nilio::core {

/// By what the time of a scan is limited.
enum class BudgetMode : std::uint8_t {
  kOff,   ///< by nothing
  kWall,  ///< by a clock: the result depends on the computer and on what else it does
  kOps,   ///< by counted work, each at a stated cost: the same result everywhere
};

/// What is counted, in units of one point: in preparation (range gate, voxel filter, deskewing, selection)
/// one of the scan, in registration one in one iteration. Finishing counts scans.
enum class Work : std::uint8_t { kPrepare, kNdt, kIcp, kFinish, kCount };
inline constexpr std::size_t kWorkKinds = static_cast<std::size_t>(Work::kCount);

/// How far a scan's registration had to be cut to keep the budget, from whole to nothing.
enum class BudgetRung : std::uint8_t {
  kFull,
  kFewerPoints,     ///< fewer points of the scan, or fewer of them in the registration
  kIcpOnly,         ///< NDT was due and left out
  kNdtOnly,         ///< no time for ICP after it
  kPredictionOnly,  ///< no time for any iteration
  kCount
};
inline constexpr std::size_t kBudgetRungs = static_cast<std::size_t>(BudgetRung::kCount);
/// "full", "fewer_points", ...
const char* name_of(BudgetMode mode);
const char* name_of(BudgetRung rung);

struct BudgetConfig {
  BudgetMode mode = BudgetMode::kOff;
  /// From the arrival of the scan's last packet to its pose.
  Duration budget = Duration::from_milliseconds(50.0);
};

/// Every answer that a clock had a part in, for one scan: with them its registration can be repeated to the
/// bit.
struct BudgetDecisions {
  static constexpr std::size_t kMaxCounts = 4;
  static constexpr std::size_t kMaxStops = 24;
  /// Numbers of points chosen, in order; of a later choice the last one holds.
  std::array<std::uint32_t, kMaxCounts> counts{};
  /// Which of the questions "is there time for another iteration", counted from 0, were answered with no.
  std::array<std::uint16_t, kMaxStops> stops{};
  std::uint8_t count_size = 0;
  std::uint8_t stop_size = 0;
};

/// Keeps the time of one scan after the other. Before work begins it says how much fits, by what such work
/// cost so far; before each iteration, whether one more does: so the end is missed by the error of a
/// prediction, not by an iteration. In ops mode time is the stated cost of the work done. Not thread-safe; no
/// allocation.
class WorkBudget {
 public:
  using ClockFunction = std::int64_t (*)();

  WorkBudget(const BudgetConfig& config, ClockFunction clock);

  /// A scan whose last packet came at `released_ns` by the clock, 0 = now. One that is exempt is not limited,
  /// and nothing is learnt of it.
  void begin_scan(std::int64_t released_ns, bool exempt);
  /// As before, but with the answers of an earlier run.
  void begin_scan(const BudgetDecisions& decisions, bool exempt);

  /// Points of the scan to look at, `most` or fewer; 0 when too few fit.
  std::size_t choose_scan_points(std::size_t most);
  /// Points to register, `most` or fewer; 0 when too few fit. With `coarse` NDT takes a share of the time
  /// first.
  std::size_t choose_registration_points(std::size_t most, bool coarse);
  /// Is there time for that much work?
  bool allows(Work work, std::size_t units);
  /// All that was done since the last call, or since the scan began, was this work.
  void done(Work work, std::size_t units);
  /// The pose is out; `iterations` of ICP went into it.
  void finish_scan(int iterations);

  [[nodiscard]] BudgetMode mode() const { return config_.mode; }
  [[nodiscard]] std::int64_t now_ns() const;
  /// By how much a pose that is handed over now, or in ops mode will be once the scan is finished, misses the
  /// deadline; negative when it is early.
  [[nodiscard]] std::int64_t overshoot_ns() const;
  [[nodiscard]] Duration budget() const { return config_.budget; }
  [[nodiscard]] const BudgetDecisions& decisions() const { return decisions_; }
  /// Something was cut or left out of this scan.
  [[nodiscard]] bool was_short() const { return short_ || decisions_.stop_size > 0; }
  /// Units of work done since the beginning, by kind.
  [[nodiscard]] const std::array<std::uint64_t, kWorkKinds>& work_done() const { return work_done_; }
  /// What an iteration of ICP is taken to cost, with as many points as were chosen last.
  [[nodiscard]] std::int64_t iteration_ns() const;
  /// What one unit is taken to cost, beside what each piece of work costs at least.
  [[nodiscard]] double cost_ns(Work work) const { return cost_ns_[static_cast<std::size_t>(work)]; }

 private:
  enum class Answers : std::uint8_t { kUnlimited, kDecided, kRepeated };

  void begin(Answers answers, std::int64_t begin_ns, std::int64_t deadline_ns);
  std::size_t choose(Work work, std::size_t rounds, std::int64_t end_ns, std::size_t least, std::size_t most);
  [[nodiscard]] std::size_t units_within(Work work, std::int64_t end_ns, std::size_t rounds,
                                         std::size_t most) const;
  std::size_t keep_choice(std::size_t chosen);
  [[nodiscard]] static double cost_units(Work work, std::size_t units);
  [[nodiscard]] std::int64_t end_of(Work work) const;
  [[nodiscard]] std::int64_t predicted_ns(Work work, std::size_t units) const;
  void learn(Work work, double sample_ns);
  void mark_lap();

  BudgetConfig config_;
  ClockFunction clock_;
  Answers answers_ = Answers::kUnlimited;
  std::int64_t counted_ns_ = 0;
  std::int64_t begin_ns_ = 0;
  /// By the clock, or by counted work, where the scan begins at 0; the largest value when it is not limited.
  std::int64_t deadline_ns_ = 0;
  std::int64_t lap_ns_ = 0;
  std::size_t registration_points_ = 0;
  bool coarse_ = false;
  bool short_ = false;
  std::uint16_t questions_ = 0;
  std::uint8_t choices_ = 0;
  BudgetDecisions decisions_;
  std::array<double, kWorkKinds> cost_ns_;
  std::array<std::uint64_t, kWorkKinds> work_done_{};
  double iterations_ = 6.0;  ///< of ICP that a scan needs, slowly averaged
};

}  // namespace nilio::core
