#include "tools/bench/odometry/report.hpp"

#include <span>

#include <catch2/catch.hpp>

using namespace nilio::tools::bench;

TEST_CASE("the share of the true path is stated only where the truth moves", "[report]") {
  Measurement measurement;
  measurement.name = "default";
  measurement.accuracy.estimate_length_m = 3.0;
  const auto share = [&] { return accuracy_table(std::span(&measurement, 1)).rows.at(0).back(); };
  CHECK(share() == "-");
  measurement.accuracy.truth_length_m = 4.0;
  CHECK(share() == "75.00 %");
}
