#include "tools/bench/report/results_page.hpp"

#include "tools/bench/common/sha256.hpp"
#include "tools/common/statistics.hpp"

#include <limits>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio::tools;
using namespace nilio::tools::bench;

TEST_CASE("SHA-256 gives the digests of FIPS 180-4's examples", "[results_page]") {
  CHECK(sha256("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  CHECK(sha256("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  // The length field needs a second block.
  CHECK(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq") ==
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  CHECK(sha256(std::string(1'000'000, 'a')) ==
        "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

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
