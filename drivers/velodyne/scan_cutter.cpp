#include "drivers/velodyne/scan_cutter.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include <algorithm>
#include <cmath>

namespace nilio::drivers {
namespace {

std::int64_t floor_divide(std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); }

}  // namespace

ScanCutter::Action ScanCutter::evaluate(std::uint16_t azimuth, std::int64_t time_ns, float rate,
                                        std::int64_t azimuth_period_ns, bool room, bool may_cut) {
  track(azimuth, time_ns, rate, azimuth_period_ns);
  if (state_ != State::kFilling) return Action::kOpen;
  if (!may_cut) return Action::kAppend;
  if (unwrapped_ >= next_cut()) return Action::kCutAtAzimuth;
  if (time_ns - start_ns_ > longest_ns_) return Action::kCutByTime;
  return room ? Action::kAppend : Action::kCutByRoom;
}

void ScanCutter::open() {
  std::int64_t revolution = floor_divide(unwrapped_, kAzimuthModulus);
  // When the azimuth jitters back, the cut is not passed a second time.
  if (state_ == State::kBetween) revolution = std::max(revolution, scan_revolution_ + 1);
  state_ = State::kFilling;
  start_ns_ = last_step_ns_;
  scan_revolution_ = revolution;
}

bool ScanCutter::next_step_cuts(float rate) const {
  if (state_ != State::kFilling) return false;
  return unwrapped_ + std::llround(rate) >= next_cut();
}

void ScanCutter::restart() {
  state_ = State::kEmpty;
  has_azimuth_ = false;
  turning_.restart();
}

/// Whole turns that time and rate explain beyond the difference of the azimuths.
std::int64_t ScanCutter::turns_between(int difference, std::int64_t time_ns, float rate,
                                       std::int64_t azimuth_period_ns) const {
  const double periods =
      static_cast<double>(time_ns - last_step_ns_) / static_cast<double>(azimuth_period_ns);
  return std::llround((periods * static_cast<double>(rate) - difference) / kAzimuthModulus);
}

/// Unwraps the azimuth over all revolutions. Rate and time bridge missing packets.
void ScanCutter::track(std::uint16_t azimuth, std::int64_t time_ns, float rate,
                       std::int64_t azimuth_period_ns) {
  if (!has_azimuth_) {
    has_azimuth_ = true;
    unwrapped_ = (static_cast<int>(azimuth) - cut_ + kAzimuthModulus) % kAzimuthModulus;
  } else {
    const int difference = static_cast<int>(azimuth) - static_cast<int>(last_azimuth_);
    unwrapped_ += difference;
    // Neighbouring steps: no turn is between them.
    const std::int64_t since_ns = time_ns - last_step_ns_;
    const bool is_next =
        std::abs(difference) < kAzimuthModulus / 4 && since_ns >= 0 && since_ns < 2 * azimuth_period_ns;
    if (!is_next) unwrapped_ += turns_between(difference, time_ns, rate, azimuth_period_ns) * kAzimuthModulus;
  }
  turning_.add(time_ns, unwrapped_);
  last_azimuth_ = azimuth;
  last_step_ns_ = time_ns;
}

}  // namespace nilio::drivers
