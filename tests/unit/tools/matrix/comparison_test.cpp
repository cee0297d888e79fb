#include "tools/bench/matrix/comparison.hpp"

#include "tests/support/temporary_folder.hpp"
#include "tools/bench/matrix/summary.hpp"

#include <fstream>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::bench;

namespace {

MatrixRun run_of(const std::string& row, std::uint64_t seed, double drift_percent) {
  MatrixRun run;
  run.row = row;
  run.number = seed;
  run.seed = seed;
  run.drive_sha256 = "drive" + std::to_string(seed);
  run.bound_percent = 1.0;
  run.figures.path_m = 100.0;
  run.figures.drift_percent = drift_percent;
  run.figures.rpe_m = 0.01;
  run.figures.ends_tracking = true;
  return run;
}

MatrixResult result_of(std::vector<MatrixRun> runs) { return {"0.1", "abc", "nilio", true, std::move(runs)}; }

}  // namespace

TEST_CASE("equal results have a ratio of one and no regression", "[comparison]") {
  const MatrixResult result = result_of({run_of("a", 1, 0.1), run_of("a", 2, 0.2), run_of("b", 1, 0.3)});
  const Comparison comparison = compare(result, result);
  CHECK(comparison.overall.ratio == Approx(1.0));
  CHECK(comparison.overall.values == 3);
  CHECK(find_regressions(comparison).empty());
}

TEST_CASE("a new failure, a row above two and an overall ratio above 1.10 are regressions", "[comparison]") {
  const MatrixResult before = result_of({run_of("a", 1, 0.1), run_of("b", 1, 0.1)});
  CHECK(find_regressions(compare(before, result_of({run_of("a", 1, 0.1), run_of("b", 1, 0.12)}))).empty());
  CHECK(find_regressions(compare(before, result_of({run_of("a", 1, 0.1), run_of("b", 1, 0.13)}))).size() ==
        1);
  CHECK(find_regressions(compare(before, result_of({run_of("a", 1, 0.04), run_of("b", 1, 0.21)}))).size() ==
        1);

  const Comparison failed = compare(before, result_of({run_of("a", 1, 0.1), run_of("b", 1, 5.0)}));
  REQUIRE(find_regressions(failed).size() == 1);
  CHECK(find_regressions(failed).front() == "new failure: b, seed 1: drift");
  // Pairs that do not both succeed have no ratio.
  CHECK(failed.overall.values == 1);
}

TEST_CASE("runs on another recording, and runs that the baseline lacks, are counted and not compared",
          "[comparison]") {
  const MatrixResult before = result_of({run_of("a", 1, 0.1), run_of("a", 2, 0.1)});
  MatrixRun other = run_of("a", 1, 50.0);
  other.drive_sha256 = "another";
  const Comparison comparison =
      compare(before, result_of({other, run_of("a", 2, 0.1), run_of("a", 3, 50.0)}));
  CHECK(comparison.other_drives == 1);
  CHECK(comparison.unmatched == 1);
  CHECK(find_regressions(comparison).empty());
}

TEST_CASE("a result that was written is read again with every figure", "[comparison]") {
  MatrixResult result = result_of({run_of("a", 18446744073709551615U, 0.125), run_of("b", 2, 0.5)});
  result.runs[0].figures.silent_error_s = 0.75;
  result.runs[0].peers["kiss"] = run_of("a", 1, 0.25).figures;
  result.runs[1].figures = {};
  result.runs[1].figures.failure = "nilio simulate: status 1: no space";
  result.complete = false;
  const tests::TemporaryFolder folder;
  const std::string path = (folder.path() / "result.json").string();
  std::ofstream(path) << to_json(result);
  const auto read = read_matrix_result(path);
  REQUIRE(read);
  CHECK(to_json(*read) == to_json(result));
  CHECK(read->runs[0].seed == 18446744073709551615U);
  CHECK(read->runs[0].peers.at("kiss").drift_percent == 0.25);
  CHECK(read->runs[1].figures.failure == result.runs[1].figures.failure);

  std::ofstream(path) << "{\"version\": 1}";
  const auto bad = read_matrix_result(path);
  REQUIRE_FALSE(bad);
  CHECK_THAT(bad.error().message, Catch::StartsWith(path + ": is no result of nilio bench matrix"));
}

TEST_CASE("a row counts successes and averages the successful drifts only", "[summary]") {
  MatrixRun silent = run_of("a", 3, 0.1);
  silent.figures.silent_error_s = 3.0;
  silent.figures.recovery_s = 1.5;
  const MatrixResult result =
      result_of({run_of("a", 1, 0.1), run_of("a", 2, 0.4), silent, run_of("a", 4, 7.0)});
  const auto rows = summarise_rows(result, "");
  REQUIRE(rows.size() == 1);
  CHECK(rows[0].runs == 4);
  CHECK(rows[0].successes == 2);
  CHECK(rows[0].drift_percent == Approx(0.2));
  CHECK(rows[0].silent_error_s == Approx(0.75));
  CHECK(rows[0].recovery_s == Approx(1.5));
  const Table failures = failure_table(result, "--quick ");
  REQUIRE(failures.rows.size() == 2);
  CHECK(failures.rows[0].back() == "`nilio bench matrix --quick --rows 'a' --seeds 3`");
}
