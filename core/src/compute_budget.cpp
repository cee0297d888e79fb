#include "nilio/core/compute_budget.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace nilio::core {

namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
// Nominal costs, ns per unit on one core of a computer of 2020: used in ops mode, and in wall mode until
// measured.
constexpr std::array<double, kWorkKindCount> kNominalCostNs = {20.0, 130.0, 60.0, 60'000.0};
// Fixed cost of a piece of work, in units. Without it small numbers of points would look expensive, and ever
// fewer would be chosen.
constexpr std::array<double, kWorkKindCount> kMinUnits = {2000.0, 50.0, 200.0, 0.0};
// Safety margin: most iterations then cost less than predicted.
constexpr double kMargin = 1.3;
// Cost estimates rise with the larger gain and fall with the smaller one; a single sample is limited.
constexpr double kRiseGain = 0.3;
constexpr double kFallGain = 0.05;
constexpr double kLargestRatio = 4.0;
constexpr double kDoubt = 0.8;
constexpr double kIterationGain = 0.05;
// Shares of the time from the start of the scan: preparation, then NDT when it is due. The remainder of a
// stage goes to the next.
constexpr double kPrepareShare = 0.5;
constexpr double kCoarseShare = 0.25;
// Minimum numbers of points for a useful registration.
constexpr std::size_t kMinScanPoints = 1000;
constexpr std::size_t kMinRegistrationPoints = 100;
constexpr std::size_t kMinRounds = 2;

}  // namespace

const char* name_of(BudgetMode mode) {
  switch (mode) {
    case BudgetMode::kOff:
      return "off";
    case BudgetMode::kWall:
      return "wall";
    case BudgetMode::kOps:
      return "ops";
  }
  return "unknown";
}

const char* name_of(DegradationLevel degradation_level) {
  switch (degradation_level) {
    case DegradationLevel::kFull:
      return "full";
    case DegradationLevel::kFewerPoints:
      return "fewer_points";
    case DegradationLevel::kIcpOnly:
      return "icp_only";
    case DegradationLevel::kNdtOnly:
      return "ndt_only";
    case DegradationLevel::kPredictionOnly:
      return "prediction";
    case DegradationLevel::kCount:
      break;
  }
  return "unknown";
}

ComputeBudget::ComputeBudget(const BudgetConfig& config, ClockFunction clock)
    : config_(config), clock_(clock), cost_ns_(kNominalCostNs) {
  if (config_.mode == BudgetMode::kWall && clock_ == nullptr) config_.mode = BudgetMode::kOff;
}

std::int64_t ComputeBudget::now_ns() const {
  return config_.mode == BudgetMode::kWall && answers_ != Answers::kRepeated ? clock_() : counted_ns_;
}

std::int64_t ComputeBudget::overshoot_ns() const {
  const std::int64_t rest =
      config_.mode == BudgetMode::kOps ? static_cast<std::int64_t>(cost_ns(WorkKind::kFinish)) : 0;
  return config_.mode == BudgetMode::kOff ? 0 : now_ns() + rest - deadline_ns_;
}

void ComputeBudget::begin(Answers answers, bool exempt, std::int64_t begin_ns, std::int64_t deadline_ns) {
  answers_ = answers;
  exempt_ = exempt;
  begin_ns_ = begin_ns;
  deadline_ns_ = deadline_ns;
  lap_ns_ = begin_ns;
  coarse_ = false;
  short_ = false;
  questions_ = 0;
  choices_ = 0;
}

void ComputeBudget::begin_scan(std::int64_t released_ns, bool exempt, Duration recovery) {
  decisions_ = {};
  counted_ns_ = 0;
  answers_ = Answers::kUnlimited;
  if (config_.mode == BudgetMode::kOff) return begin(Answers::kUnlimited, exempt, 0, kNever);
  const std::int64_t now = now_ns();
  const bool has_release = config_.mode == BudgetMode::kWall && released_ns > 0;
  const Duration time = exempt ? recovery : std::max(config_.budget, recovery);
  begin(Answers::kDecided, exempt, now, (has_release ? released_ns : now) + time.ns);
}

void ComputeBudget::begin_scan(const BudgetDecisions& decisions, bool exempt) {
  decisions_ = decisions;
  counted_ns_ = 0;
  const bool was_limited = decisions.count_size > 0 || decisions.stop_size > 0;
  begin(was_limited ? Answers::kRepeated : Answers::kUnlimited, exempt, 0, kNever);
}

double ComputeBudget::cost_units(WorkKind work, std::size_t units) {
  return static_cast<double>(units) + kMinUnits[static_cast<std::size_t>(work)];
}

std::int64_t ComputeBudget::predicted_ns(WorkKind work, std::size_t units) const {
  return static_cast<std::int64_t>(kMargin * cost_ns(work) * cost_units(work, units));
}

std::int64_t ComputeBudget::iteration_ns() const {
  return static_cast<std::int64_t>(cost_ns(WorkKind::kIcp) *
                                   cost_units(WorkKind::kIcp, registration_points_));
}

/// Deadline of this kind of work.
std::int64_t ComputeBudget::end_of(WorkKind work) const {
  const std::int64_t end = deadline_ns_ - predicted_ns(WorkKind::kFinish, 1);
  const double share = work == WorkKind::kPrepare          ? kPrepareShare
                       : work == WorkKind::kNdt && coarse_ ? kPrepareShare + kCoarseShare
                                                           : 1.0;
  return begin_ns_ + static_cast<std::int64_t>(share * static_cast<double>(end - begin_ns_));
}

std::size_t ComputeBudget::keep_choice(std::size_t chosen) {
  if (decisions_.count_size < BudgetDecisions::kMaxCounts)
    decisions_.counts[decisions_.count_size++] = static_cast<std::uint32_t>(chosen);
  return decisions_.counts[decisions_.count_size - 1U];
}

/// Number of units that fit `rounds` times before `end_ns`.
std::size_t ComputeBudget::units_within(WorkKind work, std::int64_t end_ns, std::size_t rounds,
                                        std::size_t most) const {
  const auto left = static_cast<double>(std::max<std::int64_t>(end_ns - now_ns(), 0));
  const double fitting = left / (kMargin * cost_ns(work) * static_cast<double>(rounds)) - cost_units(work, 0);
  return static_cast<std::size_t>(std::clamp(fitting, 0.0, static_cast<double>(most)));
}

std::size_t ComputeBudget::choose(WorkKind work, std::size_t rounds, std::int64_t end_ns, std::size_t least,
                                  std::size_t most) {
  if (!is_limited()) return most;
  if (answers_ == Answers::kRepeated) {
    if (decisions_.count_size == 0) return most;
    const std::uint8_t last = static_cast<std::uint8_t>(decisions_.count_size - 1);
    const std::size_t chosen = std::min<std::size_t>(decisions_.counts[std::min(choices_++, last)], most);
    short_ = short_ || chosen < most;
    return chosen;
  }
  // Fewer iterations are better than no registration.
  std::size_t fits = units_within(work, end_ns, rounds, most);
  while (fits < least && rounds > kMinRounds) fits = units_within(work, end_ns, --rounds, most);
  const std::size_t chosen = fits >= most ? most : fits >= least ? fits : 0;
  short_ = short_ || chosen < most;
  // Work that is skipped gives no cost sample: lower the estimate, or the work would be skipped for ever.
  if (chosen == 0 && config_.mode == BudgetMode::kWall) cost_ns_[static_cast<std::size_t>(work)] *= kDoubt;
  return std::min(keep_choice(chosen), most);
}

std::size_t ComputeBudget::choose_scan_points(std::size_t most) {
  return choose(WorkKind::kPrepare, 1, end_of(WorkKind::kPrepare), kMinScanPoints, most);
}

std::size_t ComputeBudget::choose_registration_points(std::size_t most, bool coarse) {
  coarse_ = coarse;
  // Preparation is still running at this point; its share is not counted here.
  const std::int64_t begin = std::max(end_of(coarse ? WorkKind::kNdt : WorkKind::kPrepare), now_ns());
  const std::int64_t time = std::max<std::int64_t>(end_of(WorkKind::kIcp) - begin, 0);
  const auto rounds = static_cast<std::size_t>(std::ceil(iterations_));
  registration_points_ = choose(WorkKind::kIcp, rounds, now_ns() + time, kMinRegistrationPoints, most);
  return registration_points_;
}

bool ComputeBudget::allows(WorkKind work, std::size_t units) {
  return !is_limited() || decide(now_ns() + predicted_ns(work, units) <= end_of(work));
}

bool ComputeBudget::allows_hypothesis() {
  return !exempt_ || answers_ == Answers::kUnlimited || decide(now_ns() < deadline_ns_);
}

/// The answer to the next question, as it is now or as recorded.
bool ComputeBudget::decide(bool is_in_time) {
  const std::uint16_t question = questions_++;
  const auto stops = decisions_.stops.begin();
  if (answers_ == Answers::kRepeated)
    return std::find(stops, stops + decisions_.stop_size, question) == stops + decisions_.stop_size &&
           (decisions_.stop_size < BudgetDecisions::kMaxStops || question < decisions_.stops.back());
  // Decisions beyond the capacity could not be repeated.
  if (decisions_.stop_size == BudgetDecisions::kMaxStops) return false;
  if (is_in_time) return true;
  decisions_.stops[decisions_.stop_size++] = question;
  return false;
}

void ComputeBudget::update(WorkKind work, double sample_ns) {
  double& cost = cost_ns_[static_cast<std::size_t>(work)];
  const double limited = std::clamp(sample_ns, cost / kLargestRatio, cost * kLargestRatio);
  cost += (limited > cost ? kRiseGain : kFallGain) * (limited - cost);
}

void ComputeBudget::record(WorkKind work, std::size_t units) {
  work_done_[static_cast<std::size_t>(work)] += units;
  if (units == 0) return mark_lap();
  counted_ns_ += static_cast<std::int64_t>(cost_ns(work) * cost_units(work, units));
  if (config_.mode != BudgetMode::kWall || answers_ == Answers::kRepeated) return;
  if (is_limited()) update(work, static_cast<double>(now_ns() - lap_ns_) / cost_units(work, units));
  mark_lap();
}

void ComputeBudget::mark_lap() {
  if (config_.mode == BudgetMode::kWall && answers_ != Answers::kRepeated) lap_ns_ = now_ns();
}

void ComputeBudget::finish_scan(int iterations) {
  record(WorkKind::kFinish, 1);
  if (!is_limited() || was_short() || iterations == 0) return;
  iterations_ += kIterationGain * (static_cast<double>(iterations) - iterations_);
}

}  // namespace nilio::core
