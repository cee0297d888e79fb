#include "tools/bench/matrix/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <random>

namespace nilio::tools::bench {

namespace {

constexpr double kZ95 = 1.959963984540054;
constexpr int kResamples = 10'000;
constexpr std::uint64_t kBootstrapSeed = 1;

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double resampled_mean(const std::vector<double>& values, std::mt19937_64& generator) {
  double sum = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) sum += values[generator() % values.size()];
  return sum / static_cast<double>(values.size());
}

}  // namespace

Interval wilson_interval(std::size_t successes, std::size_t runs) {
  if (runs == 0) return {0.0, 1.0};
  const auto n = static_cast<double>(runs);
  const double p = static_cast<double>(successes) / n;
  const double square = kZ95 * kZ95;
  const double centre = (p + square / (2.0 * n)) / (1.0 + square / n);
  const double half = kZ95 * std::sqrt(p * (1.0 - p) / n + square / (4.0 * n * n)) / (1.0 + square / n);
  return {std::max(0.0, centre - half), std::min(1.0, centre + half)};
}

double geometric_mean(std::span<const double> values) {
  if (values.empty()) return std::nan("");
  double logs = 0.0;
  for (const double value : values) logs += std::log(value);
  return std::exp(logs / static_cast<double>(values.size()));
}

MeanRatio mean_ratio(std::span<const std::vector<double>> rows_of_ratios) {
  std::vector<std::vector<double>> logs;
  MeanRatio result;
  for (const std::vector<double>& ratios : rows_of_ratios) {
    if (ratios.empty()) continue;
    logs.emplace_back();
    for (const double ratio : ratios) logs.back().push_back(std::log(ratio));
    result.values += ratios.size();
  }
  if (logs.empty()) return {std::nan(""), {std::nan(""), std::nan("")}, 0};
  const auto rows = static_cast<double>(logs.size());
  double mean = 0.0;
  for (const auto& row : logs) mean += mean_of(row) / rows;
  std::mt19937_64 generator(kBootstrapSeed);
  std::vector<double> means(kResamples, 0.0);
  for (double& resampled : means) {
    for (const auto& row : logs) resampled += resampled_mean(row, generator) / rows;
  }
  std::sort(means.begin(), means.end());
  const auto at = [&](double share) {
    return std::exp(means[static_cast<std::size_t>(share * (kResamples - 1))]);
  };
  result.ratio = std::exp(mean);
  result.interval = {at(0.025), at(0.975)};
  return result;
}

double mcnemar_p(std::size_t first, std::size_t second) {
  const std::size_t n = first + second;
  if (n == 0) return 1.0;
  // Binomial probabilities of the smaller count and less, in logarithms.
  double tail = 0.0;
  for (std::size_t k = 0; k <= std::min(first, second); ++k) {
    const double log_choose = std::lgamma(static_cast<double>(n) + 1.0) -
                              std::lgamma(static_cast<double>(k) + 1.0) -
                              std::lgamma(static_cast<double>(n - k) + 1.0);
    tail += std::exp(log_choose - static_cast<double>(n) * std::log(2.0));
  }
  return std::min(1.0, 2.0 * tail);
}

}  // namespace nilio::tools::bench
