#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tests/support/tools/run_command.hpp"
#include "tests/support/tools/simulate_support.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/trajectory.hpp"

#include <array>
#include <filesystem>
#include <fstream>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using tests::TemporaryFolder;

namespace {

/// "nilio simulate <arguments>".
tests::CommandResult capture_simulate(const std::string& arguments) {
  return tests::capture_command(tools::add_simulate_command, "simulate " + arguments);
}

int status_of_simulate(const std::string& arguments) { return capture_simulate(arguments).status; }

const std::string kShort = " --duration 1 --moving-start --moving-cars 2";

}  // namespace

TEST_CASE("the same seed gives the same bytes in every file, another seed does not", "[simulate_command]") {
  const TemporaryFolder a;
  const TemporaryFolder b;
  const TemporaryFolder c;
  REQUIRE(status_of_simulate(a.path().string() + kShort) == 0);
  REQUIRE(status_of_simulate(b.path().string() + kShort) == 0);
  REQUIRE(status_of_simulate(c.path().string() + kShort + " --seed 2") == 0);
  for (const char* name : {"lidar.pcap", "imu.candump.log", "truth.tum"}) {
    const std::string content = tests::read_file(a.path() / name);
    CHECK(content.size() > 10'000);
    CHECK(content == tests::read_file(b.path() / name));
    CHECK(content != tests::read_file(c.path() / name));
  }
  CHECK(tests::read_file(a.path() / "nilio.yaml") == tests::read_file(b.path() / "nilio.yaml"));
}

TEST_CASE("visits of a town have a frame in common, also on the way back", "[simulate_command]") {
  const TemporaryFolder folder;
  std::array<Eigen::Vector3d, 2> there;
  std::string captures;
  for (const char* const options : {" --visit 1", " --visit 2", " --visit 2 --way-back"}) {
    REQUIRE(status_of_simulate(folder.path().string() + kShort + options) == 0);
    const std::string capture = tests::read_file(folder.path() / "lidar.pcap");
    CHECK(capture != captures);
    captures = capture;
    const auto truth = tools::read_trajectory((folder.path() / "truth.tum").string());
    REQUIRE(truth.ok());
    const std::array<Eigen::Vector3d, 2> now{truth->poses.front().translation(),
                                             truth->poses.back().translation()};
    INFO(options << ": from " << now[0].transpose() << " to " << now[1].transpose());
    // 3.5 m to the left of the way there; bodies move by some centimetres.
    const bool is_back = std::string(options).find("back") != std::string::npos;
    if (std::string(options) != " --visit 1") {
      CHECK((now[is_back ? 1 : 0] - there[0]).norm() == Approx(is_back ? 3.5 : 0.0).margin(0.2));
      CHECK((now[is_back ? 0 : 1] - there[1]).norm() == Approx(is_back ? 3.5 : 0.0).margin(0.2));
    }
    if (!is_back) there = now;
  }
  CHECK(status_of_simulate(folder.path().string() + " --scene tunnel --visit 1") == 2);
}

TEST_CASE("a drive that is over before the vehicle has left its place is simulated", "[simulate_command]") {
  for (const char* seconds : {"0.5", "2.5"}) {
    const TemporaryFolder folder;
    CHECK(status_of_simulate(folder.path().string() + " --moving-cars 2 --duration " + seconds) == 0);
  }
}

TEST_CASE("the truth begins at the identity and its times are those of the IMU frames",
          "[simulate_command]") {
  const TemporaryFolder folder;
  REQUIRE(status_of_simulate(folder.path().string() + kShort +
                             " --realism ideal --imu oxts_rt3003 --imu-rate 100") == 0);
  const auto truth = tools::read_trajectory((folder.path() / "truth.tum").string());
  REQUIRE(truth.ok());
  CHECK(truth->poses.size() == 201);
  CHECK(truth->poses.front().matrix().isApprox(Eigen::Matrix4d::Identity(), 1e-9));
  CHECK(truth->poses.back().translation().norm() == Approx(10.0).margin(0.3));

  auto source = drivers::open_candump((folder.path() / "imu.candump.log").string(), "can0");
  REQUIRE(source.ok());
  auto preset = drivers::imu_preset("oxts_rt3003");
  REQUIRE(preset.ok());
  auto decoder = drivers::ImuDecoder::create(preset->mapping, preset->database);
  REQUIRE(decoder.ok());
  std::vector<core::ImuSample> samples;
  std::vector<drivers::CanFrame> frames(64);
  while (true) {
    const drivers::SourceRead read = (*source)->read(frames, core::Duration{0});
    for (std::size_t i = 0; i < read.count; ++i) {
      if (const auto sample = decoder->add(frames[i])) samples.push_back(*sample);
    }
    if (read.state != drivers::SourceState::kData) break;
  }
  REQUIRE(samples.size() == 101);
  CHECK(samples.front().stamp == truth->stamps.front());
  CHECK(samples.back().stamp == truth->stamps.back());
  CHECK(samples[50].linear_acceleration[2] == Approx(9.81).margin(1.5));
}

TEST_CASE("without an IMU neither its file nor its configuration is written", "[simulate_command]") {
  const TemporaryFolder folder;
  REQUIRE(status_of_simulate(folder.path().string() + kShort) == 0);
  CHECK_THAT(tests::read_file(folder.path() / "nilio.yaml"), Catch::Contains("preset: xsens_mti"));
  REQUIRE(status_of_simulate(folder.path().string() + kShort + " --imu none --sensor hdl64e") == 0);
  CHECK_FALSE(std::filesystem::exists(folder.path() / "imu.candump.log"));
  const std::string configuration = tests::read_file(folder.path() / "nilio.yaml");
  CHECK_THAT(configuration, Catch::Contains("model: HDL-64E-S2") && !Catch::Contains("imu:"));
}

TEST_CASE("options out of range, not a number and unknown names are refused while parsing",
          "[simulate_command]") {
  for (const char* option : {"--speed nan", "--rpm 0", "--length -5", "--range-noise inf", "--imu-rate 1e9",
                             "--sensor os1", "--return-mode triple", "--gps maybe", "--network-jitter-us -1",
                             "--rpm 1300", "--imu foo", "--moving-cars -1", "--seed x"}) {
    INFO(option);
    CHECK(status_of_simulate("somewhere " + std::string(option)) == tests::kNotAccepted);
  }
}

TEST_CASE("errors name the place and the remedy", "[simulate_command]") {
  const TemporaryFolder folder;
  tests::CommandResult result;
  SECTION("a folder that cannot be made") {
    std::ofstream(folder.path() / "file") << "x";
    const std::string path = (folder.path() / "file" / "below").string();
    result = capture_simulate(path + kShort);
    CHECK_THAT(result.errors, Catch::Contains(path) && Catch::Contains("could not be created"));
  }
  SECTION("a full disk") {
    std::filesystem::create_symlink("/dev/full", folder.path() / "lidar.pcap.partial");
    result = capture_simulate(folder.path().string() + kShort);
    CHECK_THAT(result.errors, Catch::Contains("lidar.pcap") && Catch::Contains("disk"));
  }
  SECTION("a bad line in a pose file") {
    const auto poses = folder.path() / "poses.txt";
    std::ofstream(poses) << "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 nan 0 0 1 0\n";
    result = capture_simulate(folder.path().string() + " --trajectory " + poses.string());
    CHECK_THAT(result.errors, Catch::Contains("poses.txt:2"));
  }
  CHECK(result.status == 1);
}

TEST_CASE("an option that the trajectory does not use is wrong usage", "[simulate_command]") {
  const TemporaryFolder folder;
  const tests::CommandResult result = capture_simulate(folder.path().string() + " --calib x");
  CHECK_THAT(result.errors, Catch::Contains("--calib"));
  CHECK(result.status == 2);
}

TEST_CASE("every model is available by name, and unsupported options are rejected", "[simulate_command]") {
  const TemporaryFolder folder;
  tests::CommandResult result;
  const auto errors = [&](const std::string& options) {
    result = capture_simulate(folder.path().string() + kShort + options);
    return result.errors;
  };
  CHECK_THAT(errors(" --sensor vlp-32c --return-mode dual_confidence"),
             Catch::Contains("VLP-32C has only single, dual"));
  CHECK(result.status == 2);
  CHECK_THAT(errors(" --sensor HDL-64E-S1 --gps none"), Catch::Contains("--gps: HDL-64E-S1 sends no time"));
  CHECK(result.status == 2);
  CHECK_THAT(errors(" --stream-calibration on"), Catch::Contains("VLP-16 sends no calibration"));
  CHECK(result.status == 2);
  CHECK(errors(" --sensor puckhires --return-mode dual --gps nmea --rpm 1200").empty());
  CHECK(result.status == 0);
  CHECK_THAT(tests::read_file(folder.path() / "nilio.yaml"), Catch::Contains("model: Puck-Hi-Res"));
}

TEST_CASE("the calibration that an HDL-64E sends is also written beside the recording",
          "[simulate_command]") {
  const TemporaryFolder folder;
  REQUIRE(status_of_simulate(folder.path().string() + kShort + " --realism ideal --sensor HDL-64E-S3") == 0);
  const auto path = folder.path() / "calibration.yaml";
  // By its file name only, so that the recording can be moved.
  CHECK_THAT(tests::read_file(folder.path() / "nilio.yaml"),
             Catch::Contains("calibration: calibration.yaml"));
  const auto built_in = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS3);
  const auto read = drivers::with_calibration_file(built_in, path.string());
  REQUIRE(read.ok());
  CHECK(read->lasers != built_in.lasers);
  REQUIRE(status_of_simulate(folder.path().string() + kShort +
                             " --realism ideal --sensor HDL-64E-S3 --stream-calibration off") == 0);
  CHECK_FALSE(std::filesystem::exists(path));
}
