#include "tools/evaluate/error_series.hpp"

#include "nilio/core/units.hpp"

#include <cmath>
#include <numbers>

namespace nilio::tools::evaluate {

ErrorSeries absolute_errors(const PosePairs& pairs, Alignment alignment) {
  const std::vector<Pose> aligned = align(pairs, alignment);
  ErrorSeries errors;
  for (std::size_t i = 0; i < aligned.size(); ++i) {
    errors.pair.push_back(i);
    errors.translation_m.push_back((aligned[i].translation() - pairs.truth[i].translation()).norm());
    errors.rotation_deg.push_back(rotation_angle_deg((aligned[i].inverse() * pairs.truth[i]).linear()));
  }
  return errors;
}

ErrorSeries relative_errors(const PosePairs& pairs, const RelativeStep& step) {
  const std::vector<double> lengths = path_lengths(pairs.truth);
  ErrorSeries errors;
  std::size_t end = 0;
  for (std::size_t begin = 0; begin < pairs.truth.size(); ++begin) {
    if (step.metres) {
      while (end < lengths.size() && lengths[end] - lengths[begin] < *step.metres) ++end;
    } else {
      end = begin + step.frames;
    }
    if (end >= pairs.truth.size()) break;
    const Pose motion_truth = pairs.truth[begin].inverse() * pairs.truth[end];
    const Pose motion = pairs.estimate[begin].inverse() * pairs.estimate[end];
    const Pose error = motion_truth.inverse() * motion;
    errors.pair.push_back(end);
    errors.translation_m.push_back(error.translation().norm());
    errors.rotation_deg.push_back(rotation_angle_deg(error.linear()));
  }
  return errors;
}

std::array<std::vector<double>, 3> roll_pitch_yaw_deg(const std::vector<Pose>& poses) {
  std::array<std::vector<double>, 3> angles;
  std::array<double, 3> last{};
  for (const Pose& pose : poses) {
    const Eigen::Matrix3d r = pose.linear();
    const double horizontal = std::hypot(r(0, 0), r(1, 0));
    const std::array<double, 3> now{std::atan2(r(2, 1), r(2, 2)), std::atan2(-r(2, 0), horizontal),
                                    std::atan2(r(1, 0), r(0, 0))};
    for (std::size_t i = 0; i < 3; ++i) {
      constexpr double kTurn = 2.0 * std::numbers::pi;
      last[i] = angles[i].empty() ? now[i] : now[i] + kTurn * std::round((last[i] - now[i]) / kTurn);
      angles[i].push_back(last[i] * kDegreesPerRadian);
    }
  }
  return angles;
}

}  // namespace nilio::tools::evaluate
