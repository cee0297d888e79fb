#pragma once

#include "tools/evaluate/metrics.hpp"

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

namespace nilio::tools::evaluate {

/// Errors of single poses, in the order of the pairs.
struct ErrorSeries {
  std::vector<std::size_t> pair;  ///< index of the pair of each value; of a step, that of its end
  std::vector<double> translation_m;
  std::vector<double> rotation_deg;
};

/// Absolute pose error of every pair: the values behind AbsoluteError.
ErrorSeries absolute_errors(const PosePairs& pairs, Alignment alignment);

/// Distance between the two poses of a relative error.
struct RelativeStep {
  std::size_t frames = 1;
  /// Length of the truth's path instead of a number of frames.
  std::optional<double> metres;
};

/// Relative pose error from every pair to the first one a step later; with one frame, the values behind
/// Evaluation::relative.
ErrorSeries relative_errors(const PosePairs& pairs, const RelativeStep& step);

/// Roll, pitch and yaw in degrees about fixed axes x, y, z (evo's sequence sxyz); without jumps of 360.
std::array<std::vector<double>, 3> roll_pitch_yaw_deg(const std::vector<Pose>& poses);

}  // namespace nilio::tools::evaluate
