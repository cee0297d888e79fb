#include "tools/common/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace nilio::tools {

namespace {

/// Correlation of neighbours above which the quantity moves in steps.
constexpr double kMovesInSteps = 0.5;

double mean_of(std::span<const double> values) {
  double sum = 0.0;
  for (const double value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

/// Correlation of neighbours, 0 to just below 1; negative correlation counts as 0.
double correlation(const std::vector<double>& residuals, double square_sum) {
  double product_sum = 0.0;
  for (std::size_t i = 1; i < residuals.size(); ++i) product_sum += residuals[i] * residuals[i - 1];
  const auto n = static_cast<double>(residuals.size());
  return std::clamp(product_sum / square_sum, 0.0, (n - 3.0) / (n + 3.0));
}

/// Standard error from the steps between samples, whose sum is the rise.
double error_by_steps(std::span<const double> x, std::span<const double> y) {
  const std::size_t steps = y.size() - 1;
  const auto n = static_cast<double>(steps);
  const double mean = (y[steps] - y[0]) / n;
  double square_sum = 0.0;
  for (std::size_t i = 1; i < y.size(); ++i) {
    const double residual = y[i] - y[i - 1] - mean;
    square_sum += residual * residual;
  }
  return std::sqrt(n * square_sum / (n - 1.0)) / (x[steps] - x[0]);
}

}  // namespace

LineFit fit_line(std::span<const double> x, std::span<const double> y) {
  LineFit fit;
  fit.samples = std::min(x.size(), y.size());
  if (fit.samples < 3) return fit;
  const double x_mean = mean_of(x);
  const double y_mean = mean_of(y);
  double xx = 0.0;
  double xy = 0.0;
  for (std::size_t i = 0; i < fit.samples; ++i) {
    xx += (x[i] - x_mean) * (x[i] - x_mean);
    xy += (x[i] - x_mean) * (y[i] - y_mean);
  }
  if (xx <= 0.0) return fit;
  fit.slope = xy / xx;
  fit.rise = fit.slope * (x[fit.samples - 1] - x[0]);
  std::vector<double> residuals(fit.samples);
  double square_sum = 0.0;
  for (std::size_t i = 0; i < fit.samples; ++i) {
    residuals[i] = y[i] - y_mean - fit.slope * (x[i] - x_mean);
    square_sum += residuals[i] * residuals[i];
  }
  if (square_sum <= 0.0) return fit;
  const auto n = static_cast<double>(fit.samples);
  const double r = correlation(residuals, square_sum);
  const double variance = square_sum / (n - 2.0);
  fit.standard_error = std::sqrt(variance / xx * (1.0 + r) / (1.0 - r));
  if (r > kMovesInSteps) {
    const double by_steps = error_by_steps(x.first(fit.samples), y.first(fit.samples));
    fit.standard_error = std::max(fit.standard_error, by_steps);
  }
  return fit;
}

}  // namespace nilio::tools
