#include "tools/bench/matrix/jobs.hpp"
#include "tools/bench/matrix/summary.hpp"
#include "tools/simulate/realism.hpp"

#include <map>
#include <set>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::tools;
using namespace nilio::tools::bench;

namespace {

MatrixRun tracking_run(const std::string& row, std::uint64_t seed, double drift_percent) {
  MatrixRun run;
  run.row = row;
  run.seed = seed;
  run.bound_percent = 1.0;
  run.figures.drift_percent = drift_percent;
  run.figures.poses = run.figures.tracking = 10;
  run.figures.ends_tracking = true;
  return run;
}

}  // namespace

TEST_CASE("each effect alone, none and all are driven with equal seeds of a sensor", "[effects]") {
  MatrixOptions options;
  options.runs = 6;
  std::map<std::string, std::set<std::uint64_t>> seeds;
  std::set<std::string> drives;
  for (const MatrixJob& job : make_jobs(effects_matrix(), options, "abc")) {
    const std::string sensor = job.drive.name.find("hdl64e") != std::string::npos ? "hdl64e" : "vlp16";
    seeds[sensor].insert(job.seed);
    drives.insert(job.drive.name);
    CHECK(job.rows.size() == 2);
  }
  CHECK(drives.size() == 2 * (simulate::kEffectCount + 2));
  CHECK(seeds["vlp16"].size() == 6);
  CHECK(seeds["hdl64e"].size() == 6);
  CHECK(seeds["vlp16"] != seeds["hdl64e"]);
}

TEST_CASE("the ratio of an effect is that of the seeds which succeed in both", "[effects]") {
  MatrixResult result;
  result.runs = {tracking_run("effects vlp16 ideal", 1, 0.1), tracking_run("effects vlp16 ideal", 2, 0.2),
                 tracking_run("effects vlp16 ideal", 3, 0.1), tracking_run("effects vlp16 noise", 1, 0.3),
                 tracking_run("effects vlp16 noise", 2, 0.6), tracking_run("effects vlp16 noise", 3, 5.0)};
  const Table table = effects_table(result, "vlp16");
  REQUIRE(table.rows.size() == 2);
  CHECK(table.rows[0][0] == "ideal");
  CHECK(table.rows[0][3] == "1.00 (1.00-1.00)");
  const std::vector<std::string> expected{"noise", "2/3", "0.424", "3.00 (3.00-3.00)", "-", "-", "-"};
  CHECK(table.rows[1] == expected);
  CHECK(effects_table(result, "hdl64e").rows.empty());
}
