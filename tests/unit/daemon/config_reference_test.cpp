#include "daemon/config/schema.hpp"
#include "tests/support/niliod_process.hpp"
#include "tests/support/paths.hpp"

#include <set>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio::daemon;
using nlohmann::json;

namespace {

const std::string kConfigFolder = nilio::tests::source_folder() + "/config/";

/// Section of a JSON Schema that describes the key.
json schema_of(const json& schema, const std::string& path) {
  const auto dot = path.find('.');
  const json& below = schema.at("properties").at(path.substr(0, dot));
  return dot == std::string::npos ? below : schema_of(below, path.substr(dot + 1));
}

}  // namespace

TEST_CASE("docs/configuration.md is the generated reference of the keys", "[config_reference]") {
  INFO("regenerate with: niliod --print-config-reference markdown > docs/configuration.md");
  CHECK(nilio::tests::read_file(nilio::tests::source_folder() + "/docs/configuration.md") ==
        reference_markdown());
}

TEST_CASE("config/reference.yaml is generated and has every key with its default", "[config_reference]") {
  INFO("regenerate with: niliod --print-config-reference yaml > config/reference.yaml");
  CHECK(nilio::tests::read_file(kConfigFolder + "reference.yaml") == reference_yaml());
  Config config;
  REQUIRE(apply_file(config, kConfigFolder + "reference.yaml").ok());
  CHECK(find_changes(Config{}, config).empty());
  for (const ConfigKey& key : config_keys(config)) {
    if (key.path.starts_with("lidar3.") || key.path.starts_with("lidar4.")) continue;
    INFO(key.path);
    CHECK(config.sources.origin_of.contains(key.path));
  }
}

TEST_CASE("config/vehicle.yaml has the basic keys with their defaults and no others", "[config_reference]") {
  Config config;
  REQUIRE(apply_file(config, kConfigFolder + "vehicle.yaml").ok());
  CHECK(find_changes(Config{}, config).empty());
  std::set<std::string> basic;
  std::set<std::string> given;
  for (const ConfigKey& key : config_keys(config)) {
    if (key.level == KeyLevel::kBasic) basic.insert(key.path);
  }
  for (const auto& [key, origin] : config.sources.origin_of) given.insert(key);
  CHECK(basic.size() == 8);
  CHECK(given == basic);
}

TEST_CASE("config/nilio.schema.json is generated and describes every key", "[config_reference]") {
  INFO("regenerate with: niliod --print-config-reference schema > config/nilio.schema.json");
  const std::string text = nilio::tests::read_file(kConfigFolder + "nilio.schema.json");
  CHECK(text == reference_schema());
  const json schema = json::parse(text);
  CHECK(schema.at("additionalProperties") == false);
  Config config;
  for (const ConfigKey& key : config_keys(config)) {
    INFO(key.path);
    const json described = schema_of(schema, key.path);
    CHECK(described.at("description").get<std::string>().starts_with(key.help));
    CHECK(described.at("x-level") == (key.level == KeyLevel::kBasic ? "basic" : "advanced"));
    CHECK(described.at("x-reload") == (key.reload == ReloadClass::kApplied ? "applied" : "restart"));
    const json& number = described.contains("items") ? described.at("items") : described;
    CHECK(number.contains("minimum") == (key.minimum != key.maximum));
    if (key.minimum != key.maximum) {
      CHECK(number.at("minimum").get<double>() == key.minimum);
      CHECK(number.at("maximum").get<double>() == key.maximum);
    }
    if (!key.allowed.empty()) CHECK(described.at("enum") == key.allowed);
    // JSON is YAML: the described default is the table's.
    REQUIRE(apply_override(config, key.path + "=" + described.at("default").dump()).ok());
  }
  CHECK(find_changes(Config{}, config).empty());
}

TEST_CASE("the help text of the keys describes each of them", "[config_reference]") {
  const std::string text = describe_keys();
  Config config;
  for (const ConfigKey& key : config_keys(config)) {
    CHECK(text.find(key.path + ": " + value_text(key) + "\n") != std::string::npos);
    CHECK_FALSE(key.help.empty());
  }
}
