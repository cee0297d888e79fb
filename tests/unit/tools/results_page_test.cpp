#include "tools/bench/report/results_page.hpp"

#include "tools/bench/odometry/report.hpp"

#include <limits>
#include <span>

#include <catch2/catch.hpp>

using namespace nilio::tools;
using namespace nilio::tools::bench;

TEST_CASE("tables are aligned for a terminal and Markdown on a page", "[results_page]") {
  const Table table{{"name", "ms"}, {{"a", "1.25"}, {"longer", "10.00"}}};
  CHECK(to_text(table) == "name       ms\na        1.25\nlonger  10.00\n");
  CHECK(to_markdown(table) == "| name | ms |\n|---|---:|\n| a | 1.25 |\n| longer | 10.00 |\n");
  CHECK(fixed(1.2345, 2) == "1.23");
  CHECK(fixed(std::numeric_limits<double>::quiet_NaN(), 2) == "-");
}

TEST_CASE("the share of the true path is stated only where the truth moves", "[results_page]") {
  Measurement measurement;
  measurement.name = "default";
  measurement.accuracy.estimate_length_m = 3.0;
  const auto share = [&] { return accuracy_table(std::span(&measurement, 1)).rows.at(0).back(); };
  CHECK(share() == "-");
  measurement.accuracy.truth_length_m = 4.0;
  CHECK(share() == "75.00 %");
}
