#include "tools/evaluate/run_table.hpp"

#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"

#include <fstream>
#include <iterator>
#include <string>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::tools;
using Catch::Matchers::Contains;
using nlohmann::json;
using tests::capture_command;
using tests::TemporaryFolder;

namespace {

json sound_result() {
  return {
      {"exit_status", 0},
      {"problem", ""},
      {"poses", 200},
      {"states", {{"initialising", 5}, {"tracking", 185}, {"degraded", 8}, {"lost", 2}}},
      {"resets", {{"initialisation", 3}, {"not_registered", 0}, {"not_relocalised", 0}, {"relocalised", 1}}},
      {"path_length_m", 1234.5},
      {"duration_s", 20.0},
      {"cpu_s", 3.25},
      {"time_source", "pps_locked"},
      {"versions", {{"nilio", "0.1"}}},
      {"configuration_hash", "0123456789abcdef"},
      {"trajectory_sha256", std::string(64, 'a')}};
}

std::string write_result(const TemporaryFolder& folder, const std::string& run, const json& result) {
  REQUIRE_FALSE(folder.write(run + "/result.json", result.dump()).empty());
  return folder.file(run);
}

}  // namespace

TEST_CASE("the results of sound runs become one table with status 0", "[run_table]") {
  const TemporaryFolder folder;
  const std::string first = write_result(folder, "first", sound_result());
  const std::string second = write_result(folder, "second, with a comma", sound_result());
  const auto text = capture_command(add_report_command, {"report", first, second});
  CHECK(text.status == 0);
  CHECK(text.errors.empty());
  CHECK_THAT(text.output, Contains("first"));
  CHECK_THAT(text.output, Contains("92.50"));
  CHECK_THAT(text.output, Contains("2 runs, 0 with a problem, of which 0 without a result; 2.47 km"));
  CHECK_THAT(text.output, Contains("configurations: 1, versions: 1"));

  const auto csv = capture_command(add_report_command, {"report", first, second, "--format", "csv"});
  CHECK(csv.status == 0);
  CHECK_THAT(csv.output, Contains("run,problem,exit_status,poses,tracking_percent"));
  CHECK_THAT(csv.output,
             Contains("\"" + second + "\",,0,200,92.5,4.0,1.0,1,1234.5,20.0,3.25,pps_locked,0.1,"));

  const std::string file = folder.file("table.json");
  CHECK(capture_command(add_report_command,
                        {"report", first + "/result.json", "--format", "json", "--output", file})
            .status == 0);
  std::ifstream stream(file);
  const json table = json::parse(stream);
  CHECK(table["problems"] == 0);
  CHECK(table["runs"][0]["lost_percent"] == 1.0);
  CHECK(table["runs"][0]["resets"] == 1);
}

TEST_CASE("a run without a good result is a problem of its row and status 3", "[run_table]") {
  const TemporaryFolder folder;
  const std::string sound = write_result(folder, "sound", sound_result());
  std::string bad = folder.file("killed");
  std::string problem = "no result.json";
  SECTION("killed") {}
  SECTION("damaged") {
    REQUIRE_FALSE(folder.write("killed/result.json", "{\"poses\": 1").empty());
    problem = "damaged result.json";
  }
  SECTION("of another program") {
    REQUIRE_FALSE(folder.write("killed/result.json", "{\"poses\": \"many\"}").empty());
    problem = "damaged result.json";
  }
  SECTION("its own status") {
    json lost = sound_result();
    lost["exit_status"] = 3;
    lost["problem"] = "tracking was lost at 9 of 10 poses";
    bad = write_result(folder, "lost", lost);
    problem = "tracking was lost at 9 of 10 poses";
  }
  const auto result = capture_command(add_report_command, {"report", sound, bad});
  CHECK(result.status == 3);
  CHECK_THAT(result.output, Contains(problem));
  CHECK_THAT(result.errors, Contains("1 of 2 runs have a problem"));
}

TEST_CASE("limits of the report give status 3 when a run exceeds them", "[run_table]") {
  const TemporaryFolder folder;
  const std::string run = write_result(folder, "run", sound_result());
  const auto status = [&](const std::string& option, const std::string& value) {
    return capture_command(add_report_command, {"report", run, option, value}).status;
  };
  CHECK(status("--max-lost", "1") == 0);
  CHECK(status("--max-lost", "0.9") == 3);
  CHECK(status("--max-resets", "1") == 0);
  CHECK(status("--max-resets", "0") == 3);
  CHECK(capture_command(add_report_command, {"report", run, "--output", folder.file("no/such/folder")})
            .status == 1);
}
