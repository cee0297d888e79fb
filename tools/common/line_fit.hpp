#pragma once

#include <cstddef>
#include <span>

namespace nilio::tools {

/// Least-squares line through samples.
struct LineFit {
  std::size_t samples = 0;
  double slope = 0.0;
  /// Standard error of the slope. The number of independent samples is reduced by the correlation r of
  /// consecutive residuals to n (1 - r) / (1 + r). For r above 0.5 the quantity moves in steps; then it is at
  /// least the standard error of the mean step, so that a single step is no trend, and k equal ones have a
  /// slope of k^0.5 standard errors. 0 when all samples are on the line.
  double standard_error = 0.0;
  /// Rise of the line from the first to the last sample.
  double rise = 0.0;

  /// Zero is within twice the standard error.
  [[nodiscard]] bool is_level() const { return slope * slope <= 4.0 * standard_error * standard_error; }
};

/// Fits a line; `x` increases and has the size of `y`. Fewer than three samples, or all at one x, give slope
/// 0.
LineFit fit_line(std::span<const double> x, std::span<const double> y);

}  // namespace nilio::tools
