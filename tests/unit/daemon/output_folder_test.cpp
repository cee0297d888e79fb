#include "daemon/output/output_folder.hpp"

#include "tests/support/temporary_folder.hpp"

#include <catch2/catch.hpp>

using namespace nilio::daemon;
using nilio::tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

std::string chosen(const std::string& folder, EarlierRun earlier) {
  const auto result = choose_output_folder(folder, earlier);
  REQUIRE(result.ok());
  return *result;
}

}  // namespace

TEST_CASE("a folder with the files of an earlier run is refused with both ways out", "[output_folder]") {
  const TemporaryFolder folder;
  CHECK(chosen("", EarlierRun::kRefuse).empty());
  CHECK(chosen(folder.file("run"), EarlierRun::kRefuse) == folder.file("run"));
  REQUIRE_FALSE(folder.write("run/other.txt", "x").empty());
  CHECK(chosen(folder.file("run"), EarlierRun::kRefuse) == folder.file("run"));
  REQUIRE_FALSE(folder.write("run/trajectory.tum", "x").empty());
  const auto refused = choose_output_folder(folder.file("run"), EarlierRun::kRefuse);
  REQUIRE_FALSE(refused.ok());
  CHECK(refused.error().message ==
        folder.file("run") + ": holds the files of an earlier run - choose another --output, or add --force");
  CHECK(fs::exists(folder.file("run/trajectory.tum")));
}

TEST_CASE("a live run takes the next free name beside an earlier run", "[output_folder]") {
  const TemporaryFolder folder;
  REQUIRE_FALSE(folder.write("run/trajectory.tum", "x").empty());
  CHECK(chosen(folder.file("run"), EarlierRun::kKeep) == folder.file("run-2"));
  REQUIRE_FALSE(folder.write("run-2/latency.json", "x").empty());
  CHECK(chosen(folder.file("run/"), EarlierRun::kKeep) == folder.file("run-3"));
}

TEST_CASE("overwriting removes the files of the earlier run and nothing else", "[output_folder]") {
  const TemporaryFolder folder;
  for (const char* name :
       {"run/trajectory.tum", "run/decisions.jsonl", "run/latency/map.hgrm", "run/notes.txt"})
    REQUIRE_FALSE(folder.write(name, "x").empty());
  CHECK(chosen(folder.file("run"), EarlierRun::kOverwrite) == folder.file("run"));
  CHECK_FALSE(fs::exists(folder.file("run/trajectory.tum")));
  CHECK_FALSE(fs::exists(folder.file("run/decisions.jsonl")));
  CHECK_FALSE(fs::exists(folder.file("run/latency")));
  CHECK(fs::exists(folder.file("run/notes.txt")));
}

TEST_CASE("the run to continue is the last one, if it has a map and was killed", "[output_folder]") {
  const TemporaryFolder folder;
  CHECK(find_killed_run("").empty());
  CHECK(find_killed_run(folder.file("run")).empty());
  REQUIRE_FALSE(folder.write("run/map/map.log", "x").empty());
  CHECK(find_killed_run(folder.file("run")) == folder.file("run"));
  CHECK(find_killed_run(folder.file("run/")) == folder.file("run"));
  REQUIRE_FALSE(folder.write("run-2/trajectory.tum", "x").empty());
  CHECK(find_killed_run(folder.file("run")).empty());
  REQUIRE_FALSE(folder.write("run-2/map/map.log", "x").empty());
  CHECK(find_killed_run(folder.file("run")) == folder.file("run-2"));
  REQUIRE_FALSE(folder.write("run-2/latency.json", "x").empty());
  CHECK(find_killed_run(folder.file("run")).empty());
}
