// Checks .hgrm files against the format read by HdrHistogram's plotters.
#include "ipc/histogram.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <random>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using nilio::ipc::Histogram;
using nilio::ipc::percentile_distribution;

struct Row {
  double value_ms = 0.0;
  double share = 0.0;
  std::uint64_t count = 0;
  double inverse = 0.0;  ///< 1/(1-share); 0 in the last row, which has no such column
};

struct Distribution {
  std::vector<Row> rows;
  std::string mean, deviation, max, count, buckets, sub_buckets;
};

/// Reads the lines that a plotter reads and rejects all others.
Distribution parse(const std::string& text) {
  Distribution result;
  std::istringstream in(text);
  std::string line;
  std::getline(in, line);
  CHECK(line == "       Value     Percentile TotalCount 1/(1-Percentile)");
  std::getline(in, line);
  CHECK(line.empty());
  const std::regex row_form(R"( *(\d+\.\d+) (\d\.\d{12}) +(\d+)(?: +(\d+\.\d\d))?)");
  const std::regex foot_form(R"(#\[(\w+) += +([\d.]+), (\w+(?: count)?) += +([\d.]+)\])");
  std::vector<std::string> feet;
  while (std::getline(in, line)) {
    std::smatch match;
    if (std::regex_match(line, match, row_form)) {
      REQUIRE(feet.empty());
      result.rows.push_back({std::stod(match[1]), std::stod(match[2]), std::stoull(match[3]),
                             match[4].matched ? std::stod(match[4]) : 0.0});
      continue;
    }
    INFO(line);
    REQUIRE(std::regex_match(line, match, foot_form));
    feet.push_back(match[1].str() + "," + match[3].str());
    (feet.size() == 1 ? result.mean : feet.size() == 2 ? result.max : result.buckets) = match[2];
    (feet.size() == 1 ? result.deviation : feet.size() == 2 ? result.count : result.sub_buckets) = match[4];
  }
  CHECK(feet == std::vector<std::string>{"Mean,StdDeviation", "Max,Total count", "Buckets,SubBuckets"});
  return result;
}

}  // namespace

TEST_CASE(
    "a percentile distribution is monotonic, ends at one with every value counted, and matches the values",
    "[percentile_distribution]") {
  auto histogram = std::make_unique<Histogram>();
  std::mt19937_64 random(9);
  std::lognormal_distribution<double> latency(16.0, 1.0);
  std::vector<std::int64_t> values;
  for (int i = 0; i < 50'000; ++i) {
    values.push_back(static_cast<std::int64_t>(latency(random)));
    histogram->record(values.back());
  }
  std::sort(values.begin(), values.end());
  const Distribution found = parse(percentile_distribution(histogram->snapshot()));
  REQUIRE(found.rows.size() > 50);
  CHECK(found.rows.front().share == 0.0);
  for (std::size_t i = 0; i < found.rows.size(); ++i) {
    const Row& row = found.rows[i];
    INFO(i);
    if (i > 0) {
      const Row& before = found.rows[i - 1];
      REQUIRE(row.value_ms >= before.value_ms);
      REQUIRE(row.share > before.share);
      REQUIRE(row.count >= before.count);
      // Five steps per halving of the distance to one.
      if (i + 1 < found.rows.size()) REQUIRE(1.0 - row.share >= (1.0 - before.share) * 0.79);
    }
    const auto not_above =
        std::upper_bound(values.begin(), values.end(), std::int64_t{std::llround(row.value_ms * 1e6)}) -
        values.begin();
    REQUIRE(static_cast<std::uint64_t>(not_above) == row.count);
    REQUIRE(static_cast<double>(row.count) >= row.share * static_cast<double>(values.size()) - 1e-6);
    if (i + 1 < found.rows.size()) REQUIRE(row.inverse == Approx(1.0 / (1.0 - row.share)).epsilon(0.01));
  }
  const Row& last = found.rows.back();
  CHECK(last.share == 1.0);
  CHECK(last.count == values.size());
  CHECK(last.inverse == 0.0);
  CHECK(last.value_ms == Approx(static_cast<double>(values.back()) * 1e-6));
  CHECK(std::stod(found.max) == Approx(last.value_ms));
  CHECK(std::stoull(found.count) == values.size());
  CHECK(std::stod(found.mean) == Approx(histogram->snapshot().mean() * 1e-6).epsilon(1e-4));
  CHECK(std::stod(found.deviation) == Approx(histogram->snapshot().deviation() * 1e-6).epsilon(1e-4));
  CHECK(found.buckets == "29");
  CHECK(found.sub_buckets == "256");
}

TEST_CASE("distributions without values and with one value are valid files", "[percentile_distribution]") {
  auto histogram = std::make_unique<Histogram>();
  Distribution found = parse(percentile_distribution(histogram->snapshot()));
  REQUIRE(found.rows.size() == 1);
  CHECK(found.rows[0].count == 0);
  CHECK(found.count == "0");
  histogram->record(12'345'678);
  found = parse(percentile_distribution(histogram->snapshot()));
  CHECK(found.rows.back().value_ms == Approx(12.345678));
  CHECK(found.rows.back().share == 1.0);
  CHECK(found.rows.back().count == 1);
}
