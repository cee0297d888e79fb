#pragma once

#include <cstddef>
#include <span>

namespace nilio::tools {

/// A straight line through samples by least squares.
struct LineFit {
  std::size_t samples = 0;
  double slope = 0.0;
  /// Of the slope. Neighbouring samples of a quantity that moves in steps say the same twice: the error is
  /// that of the smaller number of independent samples, by the residuals' correlation from one to the next
  /// (n (1 - r) / (1 + r), r their lag-1 autocorrelation). 0 when all samples lie on the line.
  double standard_error = 0.0;
  /// From the first to the last sample, of the line.
  double rise = 0.0;

  /// Zero lies within twice the standard error.
  [[nodiscard]] bool is_level() const { return slope * slope <= 4.0 * standard_error * standard_error; }
};

/// `x` increases; as many `y`. Fewer than three samples, or all at one x, give a line without a slope.
LineFit fit_line(std::span<const double> x, std::span<const double> y);

}  // namespace nilio::tools
