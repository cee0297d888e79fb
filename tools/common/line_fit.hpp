#pragma once

#include <cstddef>
#include <span>

namespace nilio::tools {

/// A straight line through samples by least squares.
struct LineFit {
  std::size_t samples = 0;
  double slope = 0.0;
  /// Of the slope. Of independent samples there are as many as the residuals' correlation r from one to the
  /// next leaves, n (1 - r) / (1 + r). Where r is above a half, the quantity moves in steps rather than about
  /// a line: then at least what the mean step is uncertain by, so that a single step is no trend, and k equal
  /// ones make a slope of k^0.5 standard errors. 0 when all samples lie on the line.
  double standard_error = 0.0;
  /// From the first to the last sample, of the line.
  double rise = 0.0;

  /// Zero lies within twice the standard error.
  [[nodiscard]] bool is_level() const { return slope * slope <= 4.0 * standard_error * standard_error; }
};

/// `x` increases; as many `y`. Fewer than three samples, or all at one x, give a line without a slope.
LineFit fit_line(std::span<const double> x, std::span<const double> y);

}  // namespace nilio::tools
