#pragma once

#include "ipc/records.hpp"

#include <cstdint>
#include <optional>

namespace nilio::ipc {

/// Discontinuity of map or pose at a scan.
enum class OdometryReset : std::uint8_t {
  kNone,
  kInitialisation,  ///< map reset: the first scans could not be registered to each other
  kNotRegistered,   ///< map reset: no scan could be registered
  kNotRelocalised,  ///< map reset: relocalisation failed
  kRelocalised,     ///< same map: the pose is farther away than the vehicle can have driven
};
inline constexpr std::size_t kOdometryResets = static_cast<std::size_t>(OdometryReset::kRelocalised) + 1;

/// "none", "initialisation", ...
const char* name_of(OdometryReset reset);

/// Finds resets in the poses of a run, in their order. One thread.
class OdometryResetDetector {
 public:
  OdometryReset add(const PoseRecord& record);
  /// Poses in a row that were predicted or lost, before the last one added.
  [[nodiscard]] std::uint64_t poses_without_tracking() const { return without_tracking_before_; }
  /// Distance from the previous pose to the last one added, m.
  [[nodiscard]] double step_m() const { return step_m_; }

 private:
  [[nodiscard]] bool is_jump(const PoseRecord& record) const;

  std::optional<PoseRecord> last_;
  double step_m_ = 0.0;
  std::uint64_t predicted_ = 0;
  std::uint64_t without_tracking_ = 0;
  std::uint64_t without_tracking_before_ = 0;
};

}  // namespace nilio::ipc
