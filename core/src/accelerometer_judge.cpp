#include "nilio/core/accelerometer_judge.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

// At 10 Hz a memory of 5 s, over which the noise of velocities, whose differences these are, averages out,
// and in which a vehicle does not often turn a bias far.
constexpr int kMostSpans = 50;

}  // namespace

void AccelerometerJudge::learn(const Evidence& evidence) {
  if (evidence.seconds <= 0.0 || !evidence.felt.allFinite() || !evidence.measured.allFinite()) return;
  const Vector3 support = (evidence.felt - evidence.measured) / evidence.seconds;
  if (spans_ == 0) support_ = support;
  spans_ = std::min(spans_ + 1, kMostSpans);
  const double share = 1.0 / spans_;
  const double felt_error = (support - support_).norm() * evidence.seconds;
  felt_square_ += share * (felt_error * felt_error - felt_square_);
  held_square_ += share * (evidence.held_error * evidence.held_error - held_square_);
  support_ += share * (support - support_);
}

}  // namespace nilio::core
