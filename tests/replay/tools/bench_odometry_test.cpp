#include "core/src/registration/methods.hpp"
#include "daemon/config/convert.hpp"
#include "tests/support/tools/town_drive.hpp"
#include "tools/bench/basin/trials.hpp"
#include "tools/bench/common/memory_use.hpp"
#include "tools/bench/odometry/measure.hpp"
#include "tools/bench/odometry/report.hpp"

#include <set>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using tests::read_file;
using tests::run_bench;
using tests::TemporaryFolder;
using tests::town_drive;

namespace {

BenchDataset town() {
  auto dataset = open_bench_dataset(town_drive());
  REQUIRE(dataset.ok());
  return std::move(dataset).value();
}

}  // namespace

TEST_CASE("the odometry gives the same trajectory with 1, 2 and 4 threads", "[bench_odometry][drives]") {
  std::set<std::string> hashes;
  for (const char* threads : {"1", "2", "4"}) {
    const auto run = measure_odometry(town(), "ndt_icp", {std::string("odometry.threads=") + threads}, 1);
    REQUIRE(run.ok());
    hashes.insert(run->sha256);
    CHECK(run->work.scans >= 48);
    CHECK(run->work.predicted == 0);
    CHECK(run->work.points_used <= 2000);
    CHECK(run->accuracy.truth_length_m == Approx(37.0).margin(3.0));
    REQUIRE(run->accuracy.near);
    CHECK(run->accuracy.near->translation_percent < 1.0);
    CHECK_FALSE(run->accuracy.far);
    CHECK(run->wall.per_scan.size() == run->work.scans);
    CHECK(run->cpu.total.median > 0.0);
    CHECK(run->peak_resident_bytes > 0);
  }
  CHECK(hashes.size() == 1);
}

TEST_CASE("the hash changes with the trajectory", "[bench_odometry][drives]") {
  const TemporaryFolder folder;
  const auto config = bench_config(town(), {});
  REQUIRE(config.ok());
  std::string poses;
  const auto run =
      run_odometry(town(), *config, nullptr,
                   [&](const core::Scan&, const core::OdometryResult& result, const core::Odometry&) {
                     poses += std::to_string(result.scan_end.ns) + "\n";
                   });
  REQUIRE(run.ok());
  CHECK(run->sha256.size() == 64);
  CHECK(static_cast<std::size_t>(std::count(poses.begin(), poses.end(), '\n')) == run->results.size());
  const auto other = bench_config(town(), {"odometry.registration_points=500"});
  REQUIRE(other.ok());
  const auto changed = run_odometry(town(), *other, nullptr, {});
  REQUIRE(changed.ok());
  CHECK(changed->sha256 != run->sha256);
}

TEST_CASE("every method is measured and gives a different trajectory", "[bench_odometry][drives]") {
  std::set<std::string> hashes;
  for (const core::RegistrationMethodInfo& method : core::registration_methods()) {
    CAPTURE(method.name);
    const auto run =
        measure_odometry(town(), method.name, {std::string("odometry.registration=") + method.name}, 1);
    REQUIRE(run.ok());
    hashes.insert(run->sha256);
    REQUIRE(run->accuracy.near);
    CHECK(run->accuracy.near->translation_percent < 3.0);
    CHECK((run->work.coarse_iterations > 0.0) == method.coarse);
  }
  CHECK(hashes.size() == core::registration_methods().size());
}

TEST_CASE("registering a scan does not allocate, and allocations are counted", "[bench_odometry][drives]") {
  if (!allocations_are_counted()) return;
  const std::int64_t before = allocation_count();
  const auto planted = std::make_unique<std::vector<int>>(100);
  CHECK(allocation_count() == before + 2);
  CHECK(planted->size() == 100);
  const auto run = measure_odometry(town(), "ndt_icp", {}, 1);
  REQUIRE(run.ok());
  CHECK(run->allocations_warming_up == 0);
  CHECK(run->allocations_per_scan == 0.0);
}

TEST_CASE("a data set without a truth is refused with a hint", "[bench_odometry][drives]") {
  const TemporaryFolder folder;
  std::filesystem::copy(town_drive() + "/lidar.pcap", folder.file("lidar.pcap"));
  const auto missing = open_bench_dataset(std::filesystem::path(folder.file("x")).parent_path().string());
  REQUIRE_FALSE(missing.ok());
  CHECK(missing.error().message.find(":FILE") != std::string::npos);
  const auto named = open_bench_dataset(std::filesystem::path(folder.file("x")).parent_path().string() + ":" +
                                        town_drive() + "/truth.tum");
  REQUIRE(named.ok());
  CHECK(named->truth.poses.size() > 100);
}

TEST_CASE("NDT before ICP has a larger convergence basin than ICP alone", "[bench_odometry][drives]") {
  const auto config = bench_config(town(), {});
  REQUIRE(config.ok());
  const auto pairs = collect_pairs(town(), *config, 8);
  REQUIRE(pairs.ok());
  REQUIRE(pairs->size() == 8);
  const std::array<BasinOffset, 3> offsets{{{0.0, 0.0}, {1.0, 0.0}, {2.5, 0.0}}};
  const auto counts =
      count_successes(core::registration_methods(), *pairs, offsets, daemon::odometry_config(*config), 1);
  REQUIRE(counts.size() == core::registration_methods().size());
  const std::vector<std::size_t>& ndt_icp = counts[0];
  const std::vector<std::size_t>& icp_plane = counts[2];
  CHECK(ndt_icp[0] == 8);
  CHECK(ndt_icp[1] >= 7);
  CHECK(ndt_icp[2] >= icp_plane[2]);
  CHECK(count_successes(core::registration_methods(), *pairs, offsets, daemon::odometry_config(*config), 1) ==
        counts);
}

TEST_CASE("the ablation leaves out settings without effect", "[bench_odometry][drives]") {
  const auto table = measure_ablation(town(), {"imu.enabled=false"});
  REQUIRE(table.ok());
  CHECK(table->rows.size() > 8);
  CHECK(table->rows.front().front() == "default");
  for (const auto& row : table->rows) CHECK(row[1] != "imu.enabled=false");
}

TEST_CASE("PCL is measured on the same scans, or reported as missing", "[bench_odometry][drives]") {
  const auto peers = measure_pcl(town(), {});
  if (!peers.ok()) {
    CHECK(peers.error().message.find("libpcl-dev") != std::string::npos);
    return;
  }
  CHECK(peers->size() == 4);
  for (const Measurement& peer : *peers) {
    CAPTURE(peer.name);
    CHECK(peer.wall.per_scan.size() >= 48);
    CHECK(peer.accuracy.truth_length_m == Approx(37.0).margin(3.0));
  }
}

TEST_CASE("one command writes a page with its command, tables and pictures", "[bench_odometry][drives]") {
  const TemporaryFolder folder;
  const std::string output = folder.file("results");
  REQUIRE(run_bench({"odometry", town_drive(), "--registration", "ndt_icp,icp_point", "--threads", "1,2",
                     "--output", output}) == 0);
  const std::string page = read_file(output + "/results.md");
  CHECK(page.find("Made by\n\n```sh\n") != std::string::npos);
  for (const char* part : {"| ndt_icp, 2 threads |", "| icp_point |", "### Cost", "### Trajectories"})
    CHECK(page.find(part) != std::string::npos);
  for (const char* name : {"trajectory-town.svg", "latency-town.svg"}) {
    CHECK(page.find(name) != std::string::npos);
    CHECK(read_file(output + "/" + name).find("<svg") != std::string::npos);
  }
  CHECK(run_bench({"odometry", folder.file("nowhere")}) == -1);
  CHECK(run_bench({"odometry", town_drive(), "--registration", "loam"}) == -1);
  CHECK(run_bench({"basin", town_drive(), "--pairs", "2", "--output", output}) == 0);
  CHECK(read_file(output + "/basin-town.svg").find("<svg") != std::string::npos);
}
