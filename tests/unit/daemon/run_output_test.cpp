#include "daemon/output/run_output.hpp"

#include "tests/support/temporary_folder.hpp"

#include <fstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;

namespace {

std::vector<std::string> lines_of(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

ipc::PoseRecord record_at(std::int64_t start_ns, std::int64_t end_ns) {
  ipc::PoseRecord record;
  record.scan_start_ns = start_ns;
  record.stamp_ns = end_ns;
  record.position = {2.0, 3.0, 4.0};
  record.middle_position = {1.5, 2.5, 3.5};
  record.middle_orientation_xyzw = {0.0, 0.0, 1.0, 0.0};
  return record;
}

}  // namespace

TEST_CASE("the poses of the end and of the middle of a sweep have the times of the end and the middle",
          "[run_output]") {
  const tests::TemporaryFolder folder;
  daemon::RunOutput::Options options;
  options.folder = (folder.path() / "run").string();
  auto output = daemon::RunOutput::create(options, "", [](const auto&...) {});
  REQUIRE(output);
  (*output)->add(record_at(1'900'000'000, 2'000'000'000));
  (*output)->add(record_at(2'000'000'001, 2'100'000'000));
  REQUIRE((*output)->finish({}, 0));

  const std::filesystem::path run = options.folder;
  const std::string end =
      " 2.000000000 3.000000000 4.000000000 0.000000000 0.000000000 0.000000000 1.000000000";
  const std::string middle =
      " 1.500000000 2.500000000 3.500000000 0.000000000 0.000000000 1.000000000 0.000000000";
  CHECK(lines_of(run / "trajectory.tum") ==
        std::vector<std::string>{"2.000000000" + end, "2.100000000" + end});
  CHECK(lines_of(run / "trajectory_mid.tum") ==
        std::vector<std::string>{"1.950000000" + middle, "2.050000001" + middle});
}
