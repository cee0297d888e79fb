#include "tests/support/read_all.hpp"
#include "tests/support/tools/town_drive.hpp"
#include "tools/bench/common/looping_source.hpp"
#include "tools/bench/soak/soak_run.hpp"

#include <array>
#include <cstring>

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::bench;
using tests::read_all;
using tests::read_file;
using tests::run_bench;
using tests::run_command;
using tests::TemporaryFolder;

namespace {

/// A drive through the simulated town, made once.
const SensorDrive& short_drive() {
  static const TemporaryFolder folder;
  static const SensorDrive drive = [] {
    auto opened = open_sensor_drive(tests::simulate_town(folder, "2"));
    REQUIRE(opened.ok());
    return std::move(opened).value();
  }();
  return drive;
}

std::uint32_t sensor_us(const drivers::Packet& packet) {
  std::uint32_t time = 0;
  std::memcpy(&time, packet.data.data() + 1200, sizeof(time));
  return time;
}

}  // namespace

TEST_CASE("laps of a drive continue the previous lap in packet stamps and in the sensor's clock",
          "[bench_soak][drives]") {
  const auto plan = plan_laps(std::span(&short_drive(), 1), core::Duration::from_seconds(5.0));
  REQUIRE(plan.ok());
  CHECK(plan->laps.size() == 3);
  auto source = loop_packets(*plan);
  REQUIRE(source.ok());
  const std::vector<drivers::Packet> packets = read_all(**source);
  CHECK((*source)->stats().delivered == packets.size());
  REQUIRE(packets.size() > 3000);
  CHECK(packets.back().stamp <= plan->end);
  CHECK((packets.back().stamp - packets.front().stamp).seconds() > 4.9);
  std::size_t seams = 0;
  std::size_t backwards = 0;
  std::size_t clock_apart = 0;
  for (std::size_t i = 1; i < packets.size(); ++i) {
    const core::Duration step = packets[i].stamp - packets[i - 1].stamp;
    backwards += step.ns < 0 ? 1 : 0;
    seams += step >= kLapGap ? 1 : 0;
    const std::int64_t sensor_step =
        std::int64_t{sensor_us(packets[i])} - std::int64_t{sensor_us(packets[i - 1])};
    clock_apart += std::abs(sensor_step * 1000 - step.ns) > 1'000'000 ? 1 : 0;
  }
  CHECK(seams == 2);
  CHECK(backwards == 0);
  CHECK(clock_apart == 0);
}

TEST_CASE("the CAN frames of a lap stay beside its packets", "[bench_soak][drives]") {
  const auto plan = plan_laps(std::span(&short_drive(), 1), core::Duration::from_seconds(5.0));
  REQUIRE(plan.ok());
  auto source = loop_frames(*plan);
  REQUIRE(source.ok());
  const std::vector<drivers::CanFrame> frames = read_all(**source);
  REQUIRE(frames.size() > 1000);
  for (std::size_t i = 1; i < frames.size(); ++i) REQUIRE(frames[i].stamp >= frames[i - 1].stamp);
  for (const LoopPlan::Lap& lap : plan->laps) {
    const auto in_lap = std::count_if(frames.begin(), frames.end(), [&lap](const drivers::CanFrame& frame) {
      return frame.stamp >= lap.first + lap.shift && frame.stamp <= lap.last + lap.shift;
    });
    CHECK(in_lap > 100);
  }
}

TEST_CASE("the drift of a stationary vehicle is measured exactly", "[bench_soak]") {
  StationaryDrift drift;
  for (int i = 0; i < 1800; ++i) {
    const double x = i == 700 ? 0.5 : 0.01 * (i % 2);
    drift.add({std::int64_t{i} * 100'000'000}, core::Vector3(x, 0.0, 0.0));
  }
  CHECK(drift.max_pose_m() == Approx(0.495));
  CHECK(drift.max_minute_m() == Approx((0.5 - 0.0) / 600.0).margin(1e-6));
}

TEST_CASE("a soak of some laps gives a pose for every scan, in every histogram, and a page",
          "[bench_soak][drives]") {
  const TemporaryFolder folder;
  // Too short for a verdict on memory.
  run_bench({"soak", std::filesystem::path(short_drive().files.captures.front()).parent_path(), "--minutes",
             "0.2", "--page", folder.file("soak.md"), "--domain", "231"});
  const std::string page = read_file(folder.file("soak.md"));
  CHECK(page.find("| moving | 0.2 | 6 |") != std::string::npos);
  CHECK(page.find("scans gave") == std::string::npos);
  CHECK(page.find("histograms have") == std::string::npos);
  CHECK(read_file(folder.file("memory.svg")).find("<svg") != std::string::npos);
  CHECK(run_bench({"soak"}) == -1);
  CHECK(run_bench({"soak", folder.file("nowhere")}) == -1);
  CHECK(run_bench({"soak", "--minutes", "nan"}) == -1);
}

TEST_CASE("at each seam to another place tracking is lost, reported, and recovered within twenty scans",
          "[bench_soak][drives]") {
  const TemporaryFolder folder;
  const std::string forest = folder.file("forest");
  REQUIRE(run_command(add_simulate_command, {"simulate", forest, "--scene", "forest", "--realism", "ideal",
                                             "--duration", "5"}) == 0);
  for (const bool with_imu : {true, false}) {
    auto drives = open_sensor_drives({tests::town_drive(), forest});
    REQUIRE(drives.ok());
    if (!with_imu) {
      for (SensorDrive& drive : *drives) drive.files.can_logs.clear();
    }
    StopSignals signals;
    SoakConfig config;
    config.length = core::Duration::from_seconds(30.0);
    config.domain = 231;
    const auto soak = run_soak(*drives, config, signals);
    REQUIRE(soak.ok());
    const auto [initialising, tracking, degraded, lost] = soak->states;
    const std::uint64_t seams = soak->laps - 1;
    REQUIRE(seams == 5);
    CHECK(lost >= seams);
    CHECK(initialising > 4 * seams);
    CHECK(initialising + lost < 20 * (seams + 1));
    // Poses in a forest are uncertain without an IMU, and with a rejected one.
    CHECK(initialising + degraded + lost < 35 * (seams + 1));
    CHECK(tracking + 35 * (seams + 1) > soak->poses);
    CHECK((soak->scans_with_imu > 0) == with_imu);
  }
}

TEST_CASE("the memory does not grow over five minutes of driving and ten of standstill",
          "[bench_soak][.soak]") {
  const TemporaryFolder folder;
  const std::string drive = tests::simulate_town(folder, "30");
  CHECK(run_bench({"soak", drive, "--minutes", "5", "--warm-up", "0.4"}) == 0);
  CHECK(run_bench({"soak", "--stationary", "10", "--warm-up", "0.4"}) == 0);
}
