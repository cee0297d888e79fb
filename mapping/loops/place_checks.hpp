#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "mapping/loops/place_registration.hpp"

namespace nilio::mapping {

/// Outcome of a candidate; all but the first are reasons against it, in the order of the checks.
enum class LoopVerdict : std::uint8_t {
  kAccepted,
  kFar,           ///< the paths do not come near each other
  kDrift,         ///< odometry cannot have drifted that far
  kOverlap,       ///< the places share too little
  kSupport,       ///< surfaces do not lie on each other as those of one place do
  kFreeSpace,     ///< surfaces lie where the other place has seen free space
  kAmbiguous,     ///< another shift or heading fits nearly as well
  kUnobserved,    ///< more than one direction is not observed
  kTilt,          ///< height, roll or pitch contradict gravity and odometry
  kAlone,         ///< no second loop agrees; may be accepted later
  kInconsistent,  ///< contradicts odometry and the other loops
};
/// Name in reports.
const char* verdict_name(LoopVerdict verdict);
inline constexpr std::size_t kLoopVerdicts = 11;

/// Alignment of two places with the figures of its checks.
struct CheckedAlignment {
  PlaceAlignment alignment;    ///< information with the errors that the surfaces share
  double support_share = 0.0;  ///< alignment.support over what the places support themselves
  double larger_support_share = 0.0;
  double ambiguity = 0.0;
  /// kAccepted: all checks are passed that need no odometry between the places; else the first failed one,
  /// and the figures of later ones are 0.
  LoopVerdict verdict = LoopVerdict::kAccepted;
};

/// Centres of two places of one road are nearer; farther ones have better partners.
inline constexpr double kMaxCentreMetres = 20.0;

/// Gives a planar guess the height at which both paths are equally high where they are nearest. Empty if they
/// are not near.
std::optional<core::SE3> with_height(core::SE3 guess, const Place& reference, const Place& moving);

/// Limits of the checks.
struct CheckLimits {
  double max_centre_m = kMaxCentreMetres;
  double min_support_share = 0.75;
  double max_contradiction = 0.08;
  double max_ambiguity = 0.8;                             ///< from 1 on it is not computed
  std::size_t registered_surfaces = kRegisteredSurfaces;  ///< see align_places()
};

/// Registers the places from a guess and checks the result.
CheckedAlignment check_alignment(const ComparablePlace& reference, const ComparablePlace& moving,
                                 const core::SE3& guess, const CheckLimits& limits = {});

/// Information of the alignment with the errors that its surfaces share.
core::Matrix6 with_common_errors(const core::Matrix6& information);
/// Directions that the alignment does not observe.
std::size_t unobserved_directions(const core::Matrix6& information);

}  // namespace nilio::mapping
