#include "tools/bench/matrix/jobs.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"
#include "tools/common/system.hpp"

#include <csignal>
#include <set>
#include <string>
#include <utility>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;

namespace {

std::set<std::pair<std::string, std::uint64_t>> runs_of(const std::vector<MatrixJob>& jobs) {
  std::set<std::pair<std::string, std::uint64_t>> runs;
  for (const MatrixJob& job : jobs) {
    for (const MatrixRow& row : job.rows) {
      CHECK(row.drive == job.drive.name);
      CHECK(runs.emplace(row.name, job.seed).second);
    }
  }
  return runs;
}

MatrixRun numbered_run(const std::string& row, std::size_t number, std::uint64_t seed) {
  MatrixRun run;
  run.row = row;
  run.number = number;
  run.seed = seed;
  return run;
}

}  // namespace

TEST_CASE("every row gets all its seeds, those of the first run first, and a real drive one", "[jobs]") {
  const Matrix matrix = select_rows(full_matrix(), "*town vlp16 ideal*");
  MatrixOptions options;
  options.runs = 3;
  const std::vector<MatrixJob> jobs = make_jobs(matrix, options, "abc");
  CHECK(count_runs(jobs) == 3 * matrix.rows.size());
  CHECK(runs_of(jobs).size() == count_runs(jobs));
  for (std::size_t i = 1; i < jobs.size(); ++i) CHECK(jobs[i - 1].number <= jobs[i].number);
  CHECK(make_jobs(select_rows(full_matrix(), "KITTI 04"), options, "abc").size() == 1);
}

TEST_CASE("an earlier result is repeated run by run, without the rows that are no longer there", "[jobs]") {
  const Matrix matrix = full_matrix();
  MatrixResult earlier;
  earlier.runs = {numbered_run("town vlp16 ideal", 1, 11), numbered_run("town vlp16 ideal, no IMU", 1, 11),
                  numbered_run("town vlp16 ideal", 2, 12),
                  numbered_run("forest hdl64e typical industrial", 1, 13),
                  numbered_run("a row of another version", 1, 14)};
  const std::vector<MatrixJob> jobs = repeated_jobs(matrix, earlier);
  const std::set<std::pair<std::string, std::uint64_t>> expected{{"town vlp16 ideal", 11},
                                                                 {"town vlp16 ideal, no IMU", 11},
                                                                 {"town vlp16 ideal", 12},
                                                                 {"forest hdl64e typical industrial", 13}};
  CHECK(runs_of(jobs) == expected);
  // The two rows of seed 11 share their drive.
  CHECK(jobs.size() == 3);
}

TEST_CASE("a matrix is resumed with the runs that are missing, and keeps the others as they are", "[jobs]") {
  MatrixOptions options;
  options.runs = 2;
  const std::vector<MatrixJob> jobs =
      make_jobs(select_rows(full_matrix(), "town vlp16 ideal|town vlp16 ideal, no IMU"), options, "abc");
  MatrixResult earlier;
  earlier.runs = {numbered_run("town vlp16 ideal", 1, jobs[0].seed),
                  numbered_run("town vlp16 ideal, no IMU", 2, jobs[1].seed),
                  numbered_run("town vlp16 ideal", 2, jobs[1].seed),
                  numbered_run("forest vlp16 ideal", 1, jobs[0].seed)};
  earlier.runs[0].figures.drift_percent = 0.5;
  std::vector<MatrixRun> kept;
  const std::vector<MatrixJob> remaining = remaining_jobs(jobs, earlier, kept);
  REQUIRE(kept.size() == 3);
  CHECK(kept[0].figures.drift_percent == 0.5);
  const std::set<std::pair<std::string, std::uint64_t>> expected{{"town vlp16 ideal, no IMU", jobs[0].seed}};
  CHECK(runs_of(remaining) == expected);
  CHECK(remaining.size() == 1);
}

TEST_CASE("rows without recordings are named at the start, on the page and in the result", "[jobs]") {
  const tests::TemporaryFolder folder;
  const std::string json = folder.file("result.json");
  const std::string rows = "KITTI 04|KITTI raw 0009, no IMU|town vlp16 ideal";
  auto matrix = ChildProcess::start(tests::program_folder() + "/nilio",
                                    {"bench", "matrix", "--quick", "--rows", rows, "--seeds", "1", "--data",
                                     folder.text(), "--json", json, "--page", folder.file("page.md")},
                                    folder.file("log"));
  REQUIRE(matrix);
  while (!matrix->poll()) sleep_for(core::Duration::from_milliseconds(20.0));
  CHECK(*matrix->poll() == 0);
  const std::string told =
      "skipped: no data (NILIO_DATA or --data) for 2 rows: KITTI 04; KITTI raw 0009, no IMU";
  CHECK(file_text(folder.file("log")).value_or("").starts_with(told + "\n"));
  CHECK(file_text(folder.file("page.md")).value_or("").find(told + ".") != std::string::npos);
  const auto result = read_matrix_result(json);
  REQUIRE(result);
  CHECK(result->skipped == std::vector<std::string>{"KITTI 04", "KITTI raw 0009, no IMU"});
  CHECK(result->runs.size() == 1);
}

TEST_CASE("Ctrl-C ends the matrix with status 130 and keeps the runs that were done", "[jobs]") {
  const tests::TemporaryFolder folder;
  const std::string json = (folder.path() / "result.json").string();
  const std::filesystem::path log = folder.path() / "log";
  auto matrix = ChildProcess::start(tests::program_folder() + "/nilio",
                                    {"bench", "matrix", "--quick", "--rows", "town vlp16 ideal*", "--seeds",
                                     "1,2,3,4,5,6,7,8,9", "--jobs", "1", "--json", json},
                                    log);
  REQUIRE(matrix);
  const auto text = [&] { return file_text(log.string()).value_or(""); };
  for (int i = 0; i < 6000 && text().find("[1/27,") == std::string::npos; ++i)
    sleep_for(core::Duration::from_milliseconds(20.0));
  REQUIRE(text().find("min left] town vlp16 ideal") != std::string::npos);
  matrix->send_signal(SIGINT);
  std::optional<int> status;
  for (int i = 0; i < 3000 && !status; ++i) {
    status = matrix->poll();
    sleep_for(core::Duration::from_milliseconds(20.0));
  }
  REQUIRE(status);
  CHECK(*status == 130);
  const auto result = read_matrix_result(json);
  REQUIRE(result);
  CHECK_FALSE(result->complete);
  CHECK_FALSE(result->runs.empty());
  CHECK(result->runs.size() < 27);
  for (const MatrixRun& run : result->runs) CHECK(run.figures.failure.empty());
  CHECK(text().find("; interrupted. ") != std::string::npos);
}
