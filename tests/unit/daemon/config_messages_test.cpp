#include "daemon/config/schema.hpp"

#include <set>

#include <catch2/catch.hpp>

using namespace nilio::daemon;

namespace {

/// YAML with the key in the last line; its value is `value`.
std::string yaml_of(const std::string& path, const std::string& value) {
  std::string text;
  std::string indent;
  std::size_t begin = 0;
  for (auto dot = path.find('.'); dot != std::string::npos; dot = path.find('.', begin)) {
    text += indent + path.substr(begin, dot - begin) + ":\n";
    indent += "  ";
    begin = dot + 1;
  }
  return text + indent + path.substr(begin) + ": " + value + "\n";
}

/// Message for the key in a file and its place "vehicle.yaml:3: "; the same message must result from --set
/// and the environment.
std::string error_of(const std::string& path, const std::string& value) {
  Config config;
  const std::string yaml = yaml_of(path, value);
  const auto result = apply_yaml(config, yaml, "vehicle.yaml");
  if (result) return "";
  const std::string place = "vehicle.yaml:" + std::to_string(std::ranges::count(yaml, '\n')) + ": ";
  REQUIRE(result.error().message.starts_with(place));
  const std::string message = result.error().message.substr(place.size());
  CHECK(apply_override(config, path + "=" + value).error().message == "--set: " + message);
  return message;
}

/// Value of another type, and its description in the message.
std::pair<std::string, std::string> wrong_type_of(const ConfigKey& key) {
  struct Wrong {
    std::pair<std::string, std::string> operator()(bool*) const { return {"2", "'2'"}; }
    std::pair<std::string, std::string> operator()(int*) const { return {"1.5", "'1.5'"}; }
    std::pair<std::string, std::string> operator()(double*) const { return {"far", "'far'"}; }
    std::pair<std::string, std::string> operator()(std::string*) const { return {"[a, b]", "a list of 2"}; }
    std::pair<std::string, std::string> operator()(std::vector<double>*) const {
      return {"[1, 2]", "a list of 2"};
    }
    std::pair<std::string, std::string> operator()(std::vector<std::string>*) const {
      return {"eth0", "'eth0'"};
    }
  };
  return std::visit(Wrong{}, key.target);
}

/// Ways to misspell the last name of a key that leave no other key of its section nearer.
std::vector<std::string> misspellings_of(const std::string& path) {
  const std::size_t begin = path.rfind('.') + 1;
  const std::string name = path.substr(begin);
  const std::size_t middle = name.size() / 2;
  std::string missing = name;
  missing.erase(middle, 1);
  std::string swapped = name;
  std::swap(swapped[middle - 1], swapped[middle]);
  std::vector<std::string> names{missing, swapped, name + "s", name.substr(0, name.rfind('_'))};
  std::string joined = name;
  std::erase(joined, '_');
  names.push_back(joined);
  for (std::string& misspelt : names) misspelt = path.substr(0, begin) + misspelt;
  return names;
}

std::set<std::string> names_of_keys_and_sections() {
  Config config;
  std::set<std::string> names;
  for (const ConfigKey& key : config_keys(config)) {
    for (std::size_t dot = key.path.find('.'); dot != std::string::npos; dot = key.path.find('.', dot + 1))
      names.insert(key.path.substr(0, dot));
    names.insert(key.path);
  }
  return names;
}

}  // namespace

TEST_CASE("a value of the wrong type is reported with line, key, value and what the key takes",
          "[config_messages]") {
  Config config;
  for (const ConfigKey& key : config_keys(config)) {
    const auto [value, description] = wrong_type_of(key);
    CHECK(error_of(key.path, value) == key.path + " takes " + type_text(key) + ", not " + description);
    CHECK(error_of(key.path, "{a: 1}") == key.path + " takes " + type_text(key) + ", not a section");
  }
}

TEST_CASE("a number out of range is reported with line, key, value and range", "[config_messages]") {
  Config config;
  std::size_t numbers = 0;
  for (const ConfigKey& key : config_keys(config)) {
    const bool is_list = std::holds_alternative<std::vector<double>*>(key.target);
    const bool is_whole = std::holds_alternative<int*>(key.target);
    if (!is_list && !is_whole && !std::holds_alternative<double*>(key.target)) continue;
    ++numbers;
    const auto check = [&](const std::string& value, const std::string& range) {
      const std::string text = is_list ? "[0, " + value + ", 0]" : value;
      const std::string shown = value[0] == '.' ? value.substr(1) : value;
      CHECK(error_of(key.path, text) == key.path + " is " + shown + ", allowed is " + range);
    };
    INFO(key.path);
    if (!is_whole) check(".nan", range_text(key).empty() ? "any finite number" : range_text(key));
    if (range_text(key).empty()) continue;
    check(std::to_string(static_cast<std::int64_t>(key.minimum) - 1), range_text(key));
    // Beyond the whole numbers of the program, the type is wrong.
    if (key.maximum < 2147483647)
      check(std::to_string(static_cast<std::int64_t>(key.maximum) + 1), range_text(key));
  }
  CHECK(numbers > 80);
}

TEST_CASE("an unknown choice is reported with all choices and the nearest one", "[config_messages]") {
  Config config;
  std::size_t choices = 0;
  for (const ConfigKey& key : config_keys(config)) {
    if (key.allowed.empty()) continue;
    ++choices;
    for (const std::string& choice : key.allowed) {
      const std::string misspelt = choice + choice.back();
      CHECK(error_of(key.path, misspelt) == key.path + " is '" + misspelt + "', allowed is " +
                                                type_text(key) + " (did you mean '" + choice + "'?)");
    }
  }
  CHECK(choices > 20);
}

TEST_CASE("a misspelt key is reported with its line and the key that is meant", "[config_messages]") {
  const std::set<std::string> known = names_of_keys_and_sections();
  Config config;
  for (const ConfigKey& key : config_keys(config)) {
    for (const std::string& misspelt : misspellings_of(key.path)) {
      if (known.contains(misspelt)) continue;
      const std::string error = error_of(misspelt, "1");
      INFO(error);
      CHECK(error.starts_with("unknown key '" + misspelt + "' (did you mean '"));
      CHECK(error.find("'" + key.path + "'") != std::string::npos);
    }
  }
}

TEST_CASE("a key in the wrong section, and a misspelt section, are recognised", "[config_messages]") {
  CHECK(error_of("lidar.extrinsic.rotation", "[0, 0, 0]") ==
        "unknown key 'lidar.extrinsic.rotation' (did you mean 'lidar.extrinsic.rotation_rpy_deg'?)");
  CHECK(error_of("imu.rotation", "[0, 0, 0]") ==
        "unknown key 'imu.rotation' (did you mean 'imu.extrinsic.rotation_rpy_deg'?)");
  CHECK(error_of("lidar.threads", "1") == "unknown key 'lidar.threads' (did you mean 'odometry.threads'?)");
  CHECK(error_of("domain", "1") == "unknown key 'domain' (did you mean 'publisher.domain'?)");
  CHECK(error_of("odometry.range_min", "1") ==
        "unknown key 'odometry.range_min' (did you mean 'lidar.min_range_m'?)");
  CHECK(error_of("lidr", "{port: 1}") == "unknown key 'lidr' (did you mean 'lidar'?)");
  CHECK(error_of("frobnicate", "1") == "unknown key 'frobnicate' - niliod --help-config lists all keys");
  CHECK(error_of("output.map_voxel_m", "0.3").starts_with("unknown key 'output.map_voxel_m' - remove it: "));
  Config config;
  CHECK(apply_override(config, "imu.extrinsik.translation=[0, 0, 0]").error().message ==
        "--set: unknown key 'imu.extrinsik.translation' (did you mean 'imu.extrinsic.translation'?)");
}
