#include "daemon/config/schema.hpp"
#include "tests/support/temporary_folder.hpp"

#include <array>
#include <filesystem>
#include <fstream>
#include <set>
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
  CHECK(error == "test.yaml:2: odometry.threads takes a whole number from 1 to 64, not 'two'");
  CHECK(error_of("lidar:\n  extrinsic:\n    translation: [1, 2]\n")
            .find("a list of three numbers from -50 to 50 m, not a list of 2") != std::string::npos);
  // As editors with the JSON Schema do.
  CHECK(error_of("odometry:\n  threads: \"2\"\n").find("not the text \"2\"") != std::string::npos);
  CHECK(error_of("odometry:\n  threads: 010\n").find("not '010'") != std::string::npos);
  CHECK(error_of("odometry:\n  threads:\n").find("not nothing") != std::string::npos);
  CHECK(error_of("imu: 3\n").find("'imu' is a section") != std::string::npos);
}

TEST_CASE("a value out of range is rejected with the range and its unit", "[config]") {
  CHECK(error_of("lidar:\n  max_range_m: 1000\n") ==
        "test.yaml:2: lidar.max_range_m is 1000, allowed is 5 to 300 m");
  CHECK(error_of("lidar:\n  max_range_m: .nan\n").find("is nan, allowed is 5 to 300 m") != std::string::npos);
  CHECK(error_of("lidar:\n  port: 0\n").find("1 to 65535") != std::string::npos);
}

TEST_CASE("an unknown choice is rejected with the nearest one", "[config]") {
  const std::string error = error_of("lidar:\n  model: VLP16\n");
  CHECK(error.find("test.yaml:2: lidar.model is 'VLP16', allowed is one of auto, VLP-16, ") == 0);
  CHECK(error.find("(did you mean 'VLP-16'?)") != std::string::npos);
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

TEST_CASE("environment variables override files and are overridden by --set", "[config]") {
  Config config;
  REQUIRE(
      apply_yaml(config, "lidar:\n  port: 2000\n  min_range_m: 1\npublisher:\n  domain: 3\n", "a.yaml").ok());
  const std::array<const char*, 6> environment{"PATH=/bin",
                                               "NILIO_LIDAR_PORT=2001",
                                               "NILIO_LIDAR_MIN_RANGE_M=1.5",
                                               "NILIO_LIDAR_EXTRINSIC_TRANSLATION=[1, 0, 2]",
                                               "NILIO_IMU_INTERFACE=can1",
                                               nullptr};
  REQUIRE(apply_environment(config, environment.data()).ok());
  REQUIRE(apply_override(config, "lidar.port=2002").ok());
  CHECK(config.lidar.port == 2002);
  CHECK(config.lidar.min_range_m == 1.5);
  CHECK(config.lidar.extrinsic.translation == std::vector<double>{1.0, 0.0, 2.0});
  CHECK(config.imu.interface_name == "can1");
  CHECK(config.sources.warnings.empty());

  // Values equal to the default are known to be set, too.
  config.imu.preset = "sbg_ellipse";
  const std::string text = to_yaml_with_origins(config);
  const auto has_line = [&](const std::string& line) { return text.find(line + "\n") != std::string::npos; };
  CHECK(has_line("  port: 2002  # --set"));
  CHECK(has_line("  min_range_m: 1.5  # NILIO_LIDAR_MIN_RANGE_M"));
  CHECK(has_line("  domain: 3  # a.yaml:5"));
  CHECK(has_line("  preset: \"sbg_ellipse\"  # recording"));
  CHECK(has_line("  max_range_m: 100  # default"));
  Config again;
  REQUIRE(apply_yaml(again, text, "b").ok());
  CHECK(find_changes(config, again).empty());
}

TEST_CASE("a wrong value in the environment is an error that names variable and key", "[config]") {
  Config config;
  const std::array<const char*, 2> environment{"NILIO_LIDAR_PORT=0", nullptr};
  const auto applied = apply_environment(config, environment.data());
  REQUIRE_FALSE(applied.ok());
  CHECK(applied.error().message == "NILIO_LIDAR_PORT: lidar.port is 0, allowed is 1 to 65535");
  std::set<std::string> names;
  for (const ConfigKey& key : config_keys(config)) CHECK(names.insert(environment_name(key)).second);
}

TEST_CASE("a variable that resembles a key is a warning, another one is ignored", "[config]") {
  Config config;
  const std::array<const char*, 6> environment{
      "NILIO_LIDAR_PROT=2369", "NILIO_IMU_EXTRINSIC_ROTATION=[0, 0, 0]",
      "NILIO_DATA=/data",      "NILIO_DEMO_DOMAIN=5",
      "NILIO_REQUIRE_DATA=1",  nullptr};
  REQUIRE(apply_environment(config, environment.data()).ok());
  REQUIRE(config.sources.warnings.size() == 2);
  CHECK(config.sources.warnings[0] ==
        "NILIO_LIDAR_PROT: is no key of the configuration, the variable has no effect (did you mean "
        "NILIO_LIDAR_PORT?)");
  CHECK(config.sources.warnings[1].find("NILIO_IMU_EXTRINSIC_ROTATION_RPY_DEG") != std::string::npos);
  CHECK(find_changes(Config{}, config).empty());
}

TEST_CASE("the sources of a configuration are one line with its hash", "[config]") {
  Config config;
  CHECK(describe_sources(config) == "configuration: no file; hash " + config_hash(config));
  const nilio::tests::TemporaryFolder folder;
  const std::string first = folder.write("a.yaml", "lidar: {port: 2369}\n");
  const std::string second = folder.write("b.yaml", "# nothing\n");
  REQUIRE(apply_file(config, first).ok());
  REQUIRE(apply_file(config, second).ok());
  const std::array<const char*, 2> environment{"NILIO_IMU_INTERFACE=can1", nullptr};
  REQUIRE(apply_environment(config, environment.data()).ok());
  REQUIRE(apply_overrides(config, {"log.level=debug", "odometry.threads=2"}).ok());
  CHECK(describe_sources(config) ==
        "configuration: " + first + ", " + second +
            "; environment NILIO_IMU_INTERFACE; --set log.level, odometry.threads; hash " +
            config_hash(config));
}
