#pragma once

#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include <array>
#include <cstddef>

namespace nilio::core {

/// Candidate time shifts of the gyro, evenly spaced around 0.
inline constexpr std::size_t kTimeShifts = 31;
inline constexpr Duration kShiftStep = Duration::from_milliseconds(10.0);
inline constexpr Duration kLargestShift = kShiftStep * static_cast<std::int64_t>(kTimeShifts / 2);
constexpr Duration shift_at(std::size_t index) {
  return kShiftStep * (static_cast<std::int64_t>(index) - static_cast<std::int64_t>(kTimeShifts / 2));
}

/// A direction excited in the gyro, and the registered rotation for one unit of it.
struct ObservedDirection {
  Vector3 gyro = Vector3::Zero();        ///< unit vector
  Vector3 registered = Vector3::Zero();  ///< its length is 1 / scale
  double angle_sigma = 0.0;              ///< rad; also the relative one of the scale
  bool strong = false;                   ///< exact enough for small angles
};

struct GyroAlignmentEstimate {
  std::array<ObservedDirection, 3> directions{};  ///< the first `observed`, strongest first
  std::size_t observed = 0;
  /// Shift of best agreement between gyro and registration, s, with its standard deviation; +-0.15 may mean
  /// beyond.
  double time_offset_s = 0.0;
  double time_offset_sigma_s = 0.0;
  /// Exact enough to be reported; exact enough to be kept once reported.
  bool time_offset_known = false;
  bool time_offset_found = false;
};

/// Linear fit of registered to gyro rates for each time shift: registered = A gyro + constant. The constant
/// absorbs the gyro's bias, the shift with the smallest residual is the time offset, and A on the excited
/// directions gives axes, mounting and scale. Forgetting counts scans that turn, not time, so that a straight
/// road forgets nothing.
class GyroAlignment {
 public:
  /// Adds the mean rates over one scan, rad/s: the registered one, and the gyro's for each shift.
  void add(const Vector3& registered, const std::array<Vector3, kTimeShifts>& gyro);
  [[nodiscard]] GyroAlignmentEstimate estimate() const;

 private:
  struct Sums {
    Vector3 g = Vector3::Zero();
    Matrix3 gg = Matrix3::Zero();
    Matrix3 rg = Matrix3::Zero();
  };
  struct Covariances {
    Matrix3 gg;
    Matrix3 rg;
  };
  [[nodiscard]] Covariances covariances(std::size_t shift) const;
  [[nodiscard]] double registered_variance() const;
  [[nodiscard]] double residual(std::size_t shift) const;
  void estimate_offset(std::size_t best, double least, GyroAlignmentEstimate& result) const;
  void find_directions(std::size_t best, double least, GyroAlignmentEstimate& result) const;

  std::array<Sums, kTimeShifts> sums_{};
  Vector3 r_ = Vector3::Zero();
  double rr_ = 0.0;
  double weight_ = 0.0;
};

}  // namespace nilio::core
