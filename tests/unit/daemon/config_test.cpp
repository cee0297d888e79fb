#include "daemon/config/schema.hpp"
#include "tests/support/temporary_folder.hpp"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio::daemon;

namespace {

std::string error_of(const std::string& yaml) {
  Config config;
  const auto result = apply_yaml(config, yaml, "test.yaml");
  return result ? "" : result.error().message;
}

}  // namespace

TEST_CASE("an unknown key is reported with file, line and the nearest key", "[config]") {
  const std::string error = error_of("odometry:\n  thread: 2\n");
  CHECK(error.find("test.yaml:2: unknown key 'odometry.thread'") != std::string::npos);
  CHECK(error.find("odometry.threads") != std::string::npos);
}

TEST_CASE("a value of the wrong type is rejected with the expected type", "[config]") {
  const std::string error = error_of("odometry:\n  threads: two\n");
  CHECK(error == "test.yaml:2: odometry.threads takes a whole number, not 'two'");
  CHECK(error_of("lidar:\n  extrinsic:\n    translation: [1, 2]\n").find("a list of three numbers in m") !=
        std::string::npos);
  CHECK(error_of("imu: 3\n").find("'imu' is a section") != std::string::npos);
}

TEST_CASE("a value out of range is rejected with the range and its unit", "[config]") {
  CHECK(error_of("lidar:\n  max_range_m: 1000\n") ==
        "test.yaml:2: lidar.max_range_m is 1000, allowed is 5 to 300 m");
  CHECK(error_of("lidar:\n  max_range_m: .nan\n").find("not finite") != std::string::npos);
  CHECK(error_of("lidar:\n  port: 0\n").find("1 to 65535") != std::string::npos);
}

TEST_CASE("an unknown choice is rejected with the nearest one", "[config]") {
  CHECK(error_of("lidar:\n  model: VLP16\n").find("VLP-16") != std::string::npos);
}

TEST_CASE("all problems of a file are reported at once", "[config]") {
  const std::string error = error_of("odometry:\n  threads: 0\nlidar:\n  portt: 1\n");
  CHECK(error.find("test.yaml:2:") != std::string::npos);
  CHECK(error.find("test.yaml:4:") != std::string::npos);
}

TEST_CASE("text that is not YAML is rejected with its line", "[config]") {
  CHECK(error_of("lidar:\n  model: [\n").find("test.yaml:") == 0);
  CHECK(error_of("just text\n").find("is not a configuration") != std::string::npos);
  CHECK(error_of("").empty());
}

TEST_CASE("a key or section that is given twice is rejected with both lines", "[config]") {
  CHECK(error_of("odometry:\n  threads: 1\n  coarse: auto\n  threads: 2\n") ==
        "test.yaml:4: 'odometry.threads' is already given in line 2 - remove one of them");
  CHECK(error_of("lidar:\n  port: 2368\nimu:\n  enabled: true\nlidar:\n  port: 2369\n") ==
        "test.yaml:5: 'lidar' is already given in line 1 - remove one of them\n"
        "test.yaml:6: 'lidar.port' is already given in line 2 - remove one of them");
}

TEST_CASE("an empty file and a folder are rejected as configuration, comments alone are not", "[config]") {
  const nilio::tests::TemporaryFolder folder;
  const auto error_of_file = [&](const std::string& path) {
    Config config;
    const auto applied = apply_file(config, path);
    return applied ? std::string() : applied.error().message;
  };
  const std::string empty = folder.write("empty.yaml", "");
  CHECK(error_of_file(empty) ==
        empty + ": is empty (0 bytes) - write it again, or remove it to use the defaults");
  CHECK(error_of_file(folder.text()) == folder.text() + ": cannot be read: is it a file?");
  CHECK(error_of_file(folder.write("comment.yaml", "# nothing yet\n")).empty());
}

TEST_CASE("a missing file is reported with its path", "[config]") {
  Config config;
  const auto result = apply_file(config, "/nonexistent/nilio.yaml");
  REQUIRE_FALSE(result.ok());
  CHECK(result.error().message.find("/nonexistent/nilio.yaml: cannot be read") == 0);
}

TEST_CASE("an override sets one key and is checked like a file", "[config]") {
  Config config;
  CHECK(apply_override(config, "odometry.threads=2").ok());
  CHECK(config.odometry.threads == 2);
  CHECK(apply_override(config, "publisher.interfaces=[\"127.0.0.1\"]").ok());
  CHECK(config.publisher.interfaces == std::vector<std::string>{"127.0.0.1"});
  CHECK_FALSE(apply_override(config, "odometry.threads").ok());
  CHECK_FALSE(apply_override(config, "odometry.threads=0").ok());
  CHECK_FALSE(apply_override(config, "odometry.nothing=1").ok());
  CHECK(config.odometry.threads == 2);
}

TEST_CASE("overrides are applied in order up to the first error", "[config]") {
  Config config;
  CHECK(apply_overrides(config, {"odometry.threads=2", "odometry.threads=3"}).ok());
  CHECK(config.odometry.threads == 3);
  const auto applied =
      apply_overrides(config, {"odometry.threads=4", "odometry.nothing=1", "odometry.threads=5"});
  REQUIRE_FALSE(applied.ok());
  CHECK(applied.error().message.find("odometry.nothing") != std::string::npos);
  CHECK(config.odometry.threads == 4);
}

TEST_CASE("the effective configuration reads back unchanged", "[config]") {
  Config config;
  REQUIRE(apply_yaml(config,
                     "lidar:\n  extrinsic:\n    translation: [0.1, -2, 1.73]\nimu:\n  angular_velocity_z: "
                     "{message: M, signal: S, scale: -0.0174532925}\n",
                     "a")
              .ok());
  const std::string yaml = to_yaml(config);
  Config again;
  REQUIRE(apply_yaml(again, yaml, "b").ok());
  CHECK(to_yaml(again) == yaml);
  CHECK(again.lidar.extrinsic.translation == std::vector<double>{0.1, -2.0, 1.73});
  CHECK(again.imu.angular_velocity[2].signal == "S");
}

TEST_CASE("every key is described", "[config]") {
  const std::string text = describe_keys();
  Config config;
  for (const ConfigKey& key : config_keys(config)) {
    CHECK(text.find(key.path + ":") != std::string::npos);
    CHECK_FALSE(key.help.empty());
  }
}

TEST_CASE("the shipped configuration contains the defaults", "[config]") {
  Config config;
  REQUIRE(apply_file(config, std::string(NILIO_SOURCE_DIR) + "/config/nilio.yaml").ok());
  CHECK(to_yaml(config) == to_yaml(Config{}));
}

TEST_CASE("docs/configuration.md is the generated reference of the keys", "[config]") {
  std::ifstream file(std::string(NILIO_SOURCE_DIR) + "/docs/configuration.md");
  const std::string committed{std::istreambuf_iterator<char>(file), {}};
  INFO("regenerate with: niliod --print-config-reference > docs/configuration.md");
  CHECK(committed == config_reference());
}

TEST_CASE("enabled additional LiDARs are printed, disabled ones are listed", "[config]") {
  Config config;
  CHECK(to_yaml(config).find("lidar2:") == std::string::npos);
  CHECK(to_yaml(config).find("# lidar2, lidar3, lidar4: off") != std::string::npos);
  REQUIRE(
      apply_yaml(config,
                 "lidar2: {enabled: true, sender_address: 10.0.0.2, wait_ms: 30, extrinsic: {translation: "
                 "[1, 2, 3]}}\n",
                 "a")
          .ok());
  const std::string yaml = to_yaml(config);
  CHECK(yaml.find("# lidar3, lidar4: off") != std::string::npos);
  Config again;
  REQUIRE(apply_yaml(again, yaml, "b").ok());
  CHECK(to_yaml(again) == yaml);
  CHECK(again.more_lidars[0].enabled);
  CHECK(again.more_lidars[0].wait_ms == 30.0);
  CHECK(again.more_lidars[0].extrinsic.translation == std::vector<double>{1.0, 2.0, 3.0});
  CHECK_FALSE(again.more_lidars[1].enabled);
  // Keys without effect do not exist.
  CHECK(error_of("lidar2:\n  min_coverage: 0.5\n").find("lidar2.min_coverage") != std::string::npos);
}

TEST_CASE("relative paths in a configuration file refer to its folder", "[config]") {
  const auto folder = std::filesystem::temp_directory_path() / ("nilio_config_" + std::to_string(getpid()));
  std::filesystem::create_directories(folder);
  const std::string path = (folder / "nilio.yaml").string();
  std::ofstream(path)
      << "lidar:\n  calibration: unit.yaml\nlidar2:\n  enabled: true\n  calibration: /etc/other.yaml\n";
  nilio::daemon::Config config;
  REQUIRE(nilio::daemon::apply_file(config, path).ok());
  CHECK(config.lidar.calibration == (folder / "unit.yaml").string());
  CHECK(config.more_lidars[0].calibration == "/etc/other.yaml");
  // Paths from other sources stay unchanged.
  std::ofstream(path) << "lidar:\n  port: 2369\n";
  config.lidar.calibration = "given.yaml";
  REQUIRE(nilio::daemon::apply_file(config, path).ok());
  CHECK(config.lidar.calibration == "given.yaml");
  std::filesystem::remove_all(folder);
}
