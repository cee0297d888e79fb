#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace nilio::tools {

/// Count, mean, standard deviation and extremes of numbers seen one at a time.
class Spread {
 public:
  void add(double value) {
    ++count_;
    const double difference = value - mean_;
    mean_ += difference / static_cast<double>(count_);
    squares_ += difference * (value - mean_);
    least_ = count_ == 1 ? value : std::min(least_, value);
    largest_ = count_ == 1 ? value : std::max(largest_, value);
  }

  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] bool empty() const { return count_ == 0; }
  /// All 0 while empty().
  [[nodiscard]] double mean() const { return mean_; }
  [[nodiscard]] double least() const { return least_; }
  [[nodiscard]] double largest() const { return largest_; }
  [[nodiscard]] double standard_deviation() const {
    return count_ == 0 ? 0.0 : std::sqrt(squares_ / static_cast<double>(count_));
  }

 private:
  std::uint64_t count_ = 0;
  double mean_ = 0.0;
  double squares_ = 0.0;
  double least_ = 0.0;
  double largest_ = 0.0;
};

}  // namespace nilio::tools
