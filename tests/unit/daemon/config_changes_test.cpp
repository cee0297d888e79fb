#include "daemon/config/schema.hpp"

#include <catch2/catch.hpp>

using namespace nilio::daemon;

TEST_CASE("changed keys are listed with both values and whether a restart is needed", "[config_changes]") {
  const Config from;
  Config to;
  CHECK(find_changes(from, to).empty());
  to.log.level = "debug";
  to.lidar.extrinsic.translation = {0.0, 0.5, 1.9};
  const std::vector<ConfigChange> changes = find_changes(from, to);
  REQUIRE(changes.size() == 2);
  CHECK(changes[0].key == "lidar.extrinsic.translation");
  CHECK(changes[0].from == "[0, 0, 0]");
  CHECK(changes[0].to == "[0, 0.5, 1.9]");
  CHECK(changes[0].reload == ReloadClass::kRestart);
  CHECK(changes[1].key == "log.level");
  CHECK(changes[1].from == "\"info\"");
  CHECK(changes[1].to == "\"debug\"");
  CHECK(changes[1].reload == ReloadClass::kApplied);
}

TEST_CASE("the hash of a configuration depends on its values only", "[config_changes]") {
  Config config;
  const std::string defaults = config_hash(config);
  CHECK(defaults.size() == 16);
  REQUIRE(apply_yaml(config, "# a comment\nlidar: {port: 2368}\n", "a").ok());
  CHECK(config_hash(config) == defaults);
  REQUIRE(apply_yaml(config, "lidar: {port: 2369}\n", "b").ok());
  CHECK(config_hash(config) != defaults);
  // Any key counts.
  for (const ConfigKey& key : config_keys(config)) {
    if (auto* const* flag = std::get_if<bool*>(&key.target)) **flag = !**flag;
    if (auto* const* number = std::get_if<double*>(&key.target)) **number += 1.0;
    const std::string changed = config_hash(config);
    if (auto* const* flag = std::get_if<bool*>(&key.target)) **flag = !**flag;
    if (auto* const* number = std::get_if<double*>(&key.target)) **number -= 1.0;
    INFO(key.path);
    const bool touched =
        std::holds_alternative<bool*>(key.target) || std::holds_alternative<double*>(key.target);
    CHECK((changed != config_hash(config)) == touched);
  }
}
