#include "tools/bench/report/results_page.hpp"

#include "tools/common/statistics.hpp"

#include <limits>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio::tools;
using namespace nilio::tools::bench;

TEST_CASE("percentiles are values of the set", "[results_page]") {
  CHECK(percentiles_of({}).maximum == 0.0);
  CHECK(percentiles_of({3.0}).p99 == 3.0);
  std::vector<double> values;
  for (int i = 200; i > 0; --i) values.push_back(i);
  const Percentiles percentiles = percentiles_of(values);
  CHECK(percentiles.median == 100.0);
  CHECK(percentiles.p99 == 198.0);
  CHECK(percentiles.maximum == 200.0);
}

TEST_CASE("tables are aligned for a terminal and Markdown on a page", "[results_page]") {
  const Table table{{"name", "ms"}, {{"a", "1.25"}, {"longer", "10.00"}}};
  CHECK(to_text(table) == "name       ms\na        1.25\nlonger  10.00\n");
  CHECK(to_markdown(table) == "| name | ms |\n|---|---:|\n| a | 1.25 |\n| longer | 10.00 |\n");
  CHECK(fixed(1.2345, 2) == "1.23");
  CHECK(fixed(std::numeric_limits<double>::quiet_NaN(), 2) == "-");
}
