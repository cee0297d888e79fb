#include "daemon/output/run_result.hpp"

#include "daemon/output/run_output.hpp"
#include "tests/support/temporary_folder.hpp"

#include <string>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using namespace nilio::daemon;
using core::TrackingState;
using tests::TemporaryFolder;

namespace {

/// Totals of a straight drive at 1 m and 10 m/s per pose.
class Drive {
 public:
  void add(std::size_t count, TrackingState state, bool predicted = false) {
    for (std::size_t i = 0; i < count; ++i) {
      ipc::PoseRecord record;
      record.position[0] = static_cast<double>(totals.poses());
      record.linear_velocity[0] = 10.0;
      record.stamp_ns = static_cast<std::int64_t>(totals.poses()) * 100'000'000;
      record.state = state;
      record.predicted = predicted;
      record.clock_source = core::ClockSource::kPpsLocked;
      totals.add(record);
      text += tum_line(record);
    }
  }
  RunTotals totals;
  std::string text;
};

}  // namespace

TEST_CASE("a replay that lost tracking for a moment and recovered is done", "[run_result]") {
  Drive drive;
  drive.add(1, TrackingState::kInitialising);
  drive.add(1, TrackingState::kInitialising, true);
  drive.add(3, TrackingState::kInitialising);
  drive.add(90, TrackingState::kTracking);
  drive.add(4, TrackingState::kLost, true);
  drive.add(1, TrackingState::kTracking);
  const RunResult result = drive.totals.verdict();
  CHECK(result.exit_status == kDone);
  CHECK(result.problem.empty());
  CHECK(drive.totals.count(ipc::OdometryReset::kInitialisation) == 1);
}

TEST_CASE("a replay misses the threshold when it ends lost, was reset, or was lost too often",
          "[run_result]") {
  Drive drive;
  drive.add(100, TrackingState::kTracking);
  SECTION("lost at the end") {
    drive.add(1, TrackingState::kLost, true);
    CHECK(drive.totals.verdict().problem.find("tracking was lost at 1 of 101 poses and at the end") == 0);
  }
  SECTION("reset on the way") {
    drive.add(1, TrackingState::kInitialising);
    CHECK(drive.totals.verdict().problem.find("the map was reset 1 times") != std::string::npos);
  }
  SECTION("lost for more than a twentieth") {
    drive.add(6, TrackingState::kLost, true);
    drive.add(4, TrackingState::kTracking);
    CHECK(drive.totals.verdict().problem.find("tracking was lost at 6 of 110 poses") == 0);
  }
  CHECK(drive.totals.verdict().exit_status == kBadResult);
}

TEST_CASE("the totals have states, resets, path and the digest of the trajectory file", "[run_result]") {
  Drive drive;
  drive.add(5, TrackingState::kTracking);
  drive.add(2, TrackingState::kDegraded);
  drive.add(1, TrackingState::kInitialising);
  const nlohmann::json json = drive.totals.json();
  CHECK(json["poses"] == 8);
  CHECK(json["states"] == nlohmann::json{{"initialising", 1}, {"tracking", 5}, {"degraded", 2}, {"lost", 0}});
  CHECK(json["resets"]["not_relocalised"] == 1);
  CHECK(json["path_length_m"] == 7.0);
  CHECK(json["duration_s"].get<double>() == Approx(0.7));
  CHECK(json["time_source"] == "pps_locked");
  CHECK(json["trajectory_sha256"] == sha256(drive.text));
}

TEST_CASE("the inputs of a replay are listed with size and digest", "[run_result]") {
  const TemporaryFolder folder;
  ReplayFiles files;
  files.captures = {folder.write("a.pcap", "abc"), folder.write("b.pcap", "")};
  files.kitti_sequence = folder.file("04");
  REQUIRE_FALSE(folder.write("04/velodyne/000001.bin", "b").empty());
  REQUIRE_FALSE(folder.write("04/velodyne/000000.bin", "a").empty());
  REQUIRE_FALSE(folder.write("04/times.txt", "c").empty());
  Config config;
  config.imu.dbc = folder.write("mine.dbc", "dbc");
  const auto inputs = describe_inputs(files, config, "");
  REQUIRE(inputs.ok());
  REQUIRE(inputs->size() == 4);
  CHECK((*inputs)[0] == nlohmann::json{{"path", files.captures[0]}, {"bytes", 3}, {"sha256", sha256("abc")}});
  CHECK((*inputs)[1]["bytes"] == 0);
  CHECK((*inputs)[2]["path"] == config.imu.dbc);
  CHECK(
      (*inputs)[3] ==
      nlohmann::json{{"path", files.kitti_sequence}, {"bytes", 3}, {"files", 3}, {"sha256", sha256("abc")}});
  files.captures.push_back(folder.file("gone.pcap"));
  const auto failed = describe_inputs(files, config, "");
  REQUIRE_FALSE(failed.ok());
  CHECK(failed.error().message.find("gone.pcap: cannot be read: No such file") != std::string::npos);
}

TEST_CASE("SHA-256 gives the digests of FIPS 180-4's examples", "[sha256]") {
  CHECK(sha256("") == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  CHECK(sha256("abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  // The length field needs a second block.
  CHECK(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq") ==
        "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  CHECK(sha256(std::string(1'000'000, 'a')) ==
        "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}
