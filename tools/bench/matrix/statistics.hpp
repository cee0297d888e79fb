#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace nilio::tools::bench {

struct Interval {
  double low = 0.0;
  double high = 0.0;
};

/// 95 % interval of a probability of which `successes` of `runs` are known (Wilson 1927). [0, 1] without
/// runs.
Interval wilson_interval(std::size_t successes, std::size_t runs);

/// Smaller drifts count as this one, so that a ratio of two exists.
inline constexpr double kMinDriftPercent = 1e-3;

/// Of positive values; NaN for none.
double geometric_mean(std::span<const double> values);

/// Mean of the rows' means of logarithms, as a ratio, and its 95 % interval: bootstrap over the values of
/// each row (stratified), 10,000 times with a fixed seed. Rows without values are left out; NaN if all are.
struct MeanRatio {
  double ratio = 0.0;
  Interval interval;
  std::size_t values = 0;
};
MeanRatio mean_ratio(std::span<const std::vector<double>> rows_of_ratios);

/// Two-sided p of the exact test of McNemar for `first` runs that only one method fails and `second` that
/// only the other fails: a fair coin gives a division at least as uneven.
double mcnemar_p(std::size_t first, std::size_t second);

}  // namespace nilio::tools::bench
