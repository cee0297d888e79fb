#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace nilio::tools {

/// Count, mean, standard deviation and extremes of numbers that are added one at a time. Not thread-safe.
class Spread {
 public:
  void add(double value) {
    ++count_;
    const double difference = value - mean_;
    mean_ += difference / static_cast<double>(count_);
    squares_ += difference * (value - mean_);
    minimum_ = count_ == 1 ? value : std::min(minimum_, value);
    maximum_ = count_ == 1 ? value : std::max(maximum_, value);
  }

  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] bool empty() const { return count_ == 0; }
  /// The following are 0 while empty().
  [[nodiscard]] double mean() const { return mean_; }
  [[nodiscard]] double minimum() const { return minimum_; }
  [[nodiscard]] double maximum() const { return maximum_; }
  /// Of the population, not of a sample.
  [[nodiscard]] double standard_deviation() const {
    return count_ == 0 ? 0.0 : std::sqrt(squares_ / static_cast<double>(count_));
  }

 private:
  std::uint64_t count_ = 0;
  double mean_ = 0.0;
  double squares_ = 0.0;
  double minimum_ = 0.0;
  double maximum_ = 0.0;
};

/// The value that a share, 0 to 1, of the others does not exceed. Needs values.
template <class Value>
Value order_statistic(std::vector<Value> values, double share) {
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// The upper one of two. Needs values.
template <class Value>
Value median(std::vector<Value> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Order statistics; each is one of the values.
struct Percentiles {
  double median = 0.0;  ///< the lower one of two
  double p99 = 0.0;     ///< the smallest value that 99 % of the values do not exceed
  double maximum = 0.0;
};

/// All zero for no values.
inline Percentiles percentiles_of(std::vector<double> values) {
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const auto rank = static_cast<std::size_t>(std::ceil(0.99 * static_cast<double>(values.size()))) - 1;
  return {values[(values.size() - 1) / 2], values[rank], values.back()};
}

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
