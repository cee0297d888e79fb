#include "core/src/recovery/initial_motions.hpp"

#include "core/src/prefault.hpp"
#include "core/src/recovery/tracking_gate.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

/// Information of the scan along the vehicle's x axis; zero where the solver finds it degenerate.
double information_ahead(const InitialMotion& motion) {
  const RegistrationResult& registration = motion.alignment.registration;
  return (registration.degenerate_axes & 1U) != 0 ? 0.0 : registration.information(0, 0);
}

bool agrees_less(const InitialMotion& a, const InitialMotion& b) {
  return a.alignment.agreement() < b.alignment.agreement();
}

bool observes_less_ahead(const InitialMotion& a, const InitialMotion& b) {
  return information_ahead(a) < information_ahead(b);
}

bool is_same(const InitialMotion& a, const InitialMotion& b) {
  return a.motion.prior.is_stationary == b.motion.prior.is_stationary &&
         (a.alignment.pose().translation - b.alignment.pose().translation).norm() < kMinSigmaMetres;
}

}  // namespace

InitialMotions::InitialMotions(std::size_t max_points) {
  for (std::vector<SweepPoint>& sweep : sweeps_) prefault(max_points, sweep);
  // The stationary vehicle is one more.
  prefault(kSpeeds.size() + 1, motions_);
}

void InitialMotions::begin(const std::vector<SweepPoint>& sweep, const SweepSpan& span) {
  motions_.clear();
  sweeps_[0] = sweep;
  count_ = 1;
  first_span_ = span;
}

void InitialMotions::add(const MotionEstimator::Hypothesis& motion, const Alignment& alignment) {
  motions_.push_back({motion, alignment, {first_}});
}

bool InitialMotions::keep_stationary() {
  const auto best_moving = std::max_element(motions_.begin() + 1, motions_.end(), agrees_less);
  const double stationary = motions_.front().alignment.agreement();
  if (kAgreementCollapse * best_moving->alignment.agreement() <= stationary) {
    keep_first();
    return true;
  }
  motions_.erase(motions_.begin());
  return false;
}

void InitialMotions::replace(InitialMotion& found, const MotionEstimator::Hypothesis& motion,
                             const Alignment& alignment) {
  found = {motion, alignment, {first_}};
}

void InitialMotions::drop_equal() {
  const auto has_better = [&](const InitialMotion& dropped) {
    return std::any_of(motions_.begin(), motions_.end(), [&](const InitialMotion& other) {
      return is_same(dropped, other) && agrees_less(dropped, other);
    });
  };
  std::erase_if(motions_, has_better);
}

void InitialMotions::keep_likely() {
  const auto is_beaten = [&](const InitialMotion& beaten) {
    return std::any_of(motions_.begin(), motions_.end(), [&](const InitialMotion& other) {
      return agrees_less(beaten, other) &&
             beaten.alignment.mean_agreement() < kAgreementCollapse * other.alignment.mean_agreement();
    });
  };
  std::erase_if(motions_, is_beaten);
  drop_equal();
  const bool has_planes = sweeps().size() > 1;
  std::iter_swap(motions_.begin(), std::max_element(motions_.begin(), motions_.end(),
                                                    has_planes ? observes_less_ahead : agrees_less));
}

void InitialMotions::end_scan(const std::vector<SweepPoint>& sweep) {
  if (count_ == sweeps_.size()) return keep_first();
  for (InitialMotion& motion : motions_) {
    const MotionPrior& prior = motion.motion.prior;
    MotionFilter& filter = motion.motion.filter;
    filter = updated(filter, motion.alignment.registration);
    filter.take_tilt();
    motion.earlier[count_] = {SweepMotion(prior.span, filter.state(), prior.inputs),
                              filter.state().T_map_base};
  }
  sweeps_[count_++] = sweep;
}

}  // namespace nilio::core
