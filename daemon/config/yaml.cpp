#include "nilio/drivers/common/nearest_name.hpp"

#include "daemon/config/schema.hpp"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <map>
#include <sstream>
#include <system_error>
#include <type_traits>
#include <utility>

#include <yaml-cpp/yaml.h>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

std::string number(double value) {
  std::ostringstream out;
  out << std::setprecision(10) << value;
  return out.str();
}

std::string range_text(const ConfigKey& key) {
  if (key.minimum == key.maximum) return "";
  return number(key.minimum) + " to " + number(key.maximum) + (key.unit.empty() ? "" : " " + key.unit);
}

std::string type_text(const ConfigKey& key) {
  struct Name {
    std::string operator()(bool*) const { return "true or false"; }
    std::string operator()(int*) const { return "a whole number"; }
    std::string operator()(double*) const { return "a number"; }
    std::string operator()(std::string*) const { return "text"; }
    std::string operator()(std::vector<double>*) const { return "a list of three numbers"; }
    std::string operator()(std::vector<std::string>*) const { return "a list of texts"; }
  };
  return std::visit(Name{}, key.target);
}

/// Error text for a number out of range; empty if the number is allowed.
std::string check_number(const ConfigKey& key, double value) {
  if (!std::isfinite(value)) return "is not finite";
  if (key.minimum != key.maximum && (value < key.minimum || value > key.maximum)) {
    return "is " + number(value) + ", allowed is " + range_text(key);
  }
  return "";
}

/// Stores a YAML value in the key's target. Returns the error text, empty on success.
struct Store {
  const ConfigKey& key;
  const YAML::Node& node;

  [[nodiscard]] std::string wrong_type() const {
    std::string text = "takes " + type_text(key);
    if (!key.unit.empty()) text += " in " + key.unit;
    if (node.IsScalar()) text += ", not '" + node.Scalar() + "'";
    return text;
  }
  /// bool, int or double.
  template <class Scalar>
  std::string operator()(Scalar* target) const {
    Scalar value{};
    if (!node.IsScalar() || !YAML::convert<Scalar>::decode(node, value)) return wrong_type();
    if constexpr (!std::is_same_v<Scalar, bool>) {
      if (std::string problem = check_number(key, value); !problem.empty()) return problem;
    }
    *target = value;
    return "";
  }
  std::string operator()(std::string* target) const {
    if (!node.IsScalar()) return wrong_type();
    const std::string value = node.Scalar();
    if (!key.allowed.empty() &&
        std::find(key.allowed.begin(), key.allowed.end(), value) == key.allowed.end()) {
      return "is '" + value + "'" + drivers::nearest_name_hint(value, key.allowed);
    }
    *target = value;
    return "";
  }
  std::string operator()(std::vector<double>* target) const {
    if (!node.IsSequence() || node.size() != 3) return wrong_type();
    std::vector<double> values;
    for (const YAML::Node& element : node) {
      double value = 0.0;
      if (!element.IsScalar() || !YAML::convert<double>::decode(element, value)) return wrong_type();
      const std::string problem = check_number(key, value);
      if (!problem.empty()) return problem;
      values.push_back(value);
    }
    *target = values;
    return "";
  }
  std::string operator()(std::vector<std::string>* target) const {
    if (!node.IsSequence()) return wrong_type();
    std::vector<std::string> values;
    for (const YAML::Node& element : node) {
      if (!element.IsScalar()) return wrong_type();
      values.push_back(element.Scalar());
    }
    *target = values;
    return "";
  }
};

class Loader {
 public:
  Loader(Config& config, std::string name) : keys_(config_keys(config)), name_(std::move(name)) {
    for (const ConfigKey& key : keys_) known_.push_back(key.path);
  }

  void apply(const YAML::Node& node, const std::string& path) {
    for (const ConfigKey& key : keys_) {
      if (key.path != path) continue;
      const std::string problem = std::visit(Store{key, node}, key.target);
      if (!problem.empty()) add_problem(node, path + " " + problem);
      return;
    }
    if (!is_section(path)) {
      add_problem(node, "unknown key '" + path + "'" + drivers::nearest_name_hint(path, known_));
    } else if (node.IsMap()) {
      for (const auto& entry : node) apply_entry(entry.first, entry.second, path);
    } else if (!node.IsNull()) {
      add_problem(node, "'" + path + "' is a section and takes keys below it");
    }
  }

  void apply_entry(const YAML::Node& key, const YAML::Node& value, const std::string& parent) {
    const std::string name = key.IsScalar() ? key.Scalar() : "?";
    const std::string path = parent.empty() ? name : parent + "." + name;
    const auto [first, is_new] = lines_.emplace(path, key.Mark().line + 1);
    if (!is_new)
      add_problem(key, "'" + path + "' is already given in line " + std::to_string(first->second) +
                           " - remove one of them");
    apply(value, path);
  }

  [[nodiscard]] Result<std::monostate> result() const {
    if (problems_.empty()) return std::monostate{};
    return Error{problems_};
  }

 private:
  [[nodiscard]] bool is_section(const std::string& path) const {
    return std::any_of(known_.begin(), known_.end(),
                       [&](const std::string& key) { return key.starts_with(path + "."); });
  }

  void add_problem(const YAML::Node& node, const std::string& text) {
    if (!problems_.empty()) problems_ += '\n';
    problems_ += name_;
    if (!node.Mark().is_null()) problems_ += ":" + std::to_string(node.Mark().line + 1);
    problems_ += ": " + text;
  }

  std::vector<ConfigKey> keys_;
  std::vector<std::string> known_;
  std::string name_;
  std::string problems_;
  /// First line of each key and section.
  std::map<std::string, int> lines_;
};

}  // namespace

Result<std::monostate> apply_yaml(Config& config, const std::string& text, const std::string& name) {
  try {
    const YAML::Node root = YAML::Load(text);
    if (root.IsNull()) return std::monostate{};
    if (!root.IsMap())
      return Error{name + ": is not a configuration: expected 'section:' with 'key: value' below it"};
    Loader loader(config, name);
    for (const auto& entry : root) loader.apply_entry(entry.first, entry.second, "");
    return loader.result();
  } catch (const YAML::Exception& exception) {
    return Error{name + ":" + std::to_string(exception.mark.line + 1) + ": is not YAML: " + exception.msg};
  }
}

namespace {

std::vector<std::string*> named_files(Config& config) {
  std::vector<std::string*> names{&config.lidar.calibration, &config.imu.dbc};
  for (ExtraLidarConfig& other : config.more_lidars) names.push_back(&other.calibration);
  return names;
}

}  // namespace

Result<std::monostate> apply_file(Config& config, const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return Error{path + ": cannot be read: check the path and the permissions"};
  std::ostringstream text;
  text << file.rdbuf();
  // Reading a folder gives no text either.
  if (text.fail()) {
    std::error_code error;
    const bool is_empty = std::filesystem::file_size(path, error) == 0 && !error;
    return Error{path + (is_empty ? ": is empty (0 bytes) - write it again, or remove it to use the defaults"
                                  : ": cannot be read: is it a file?")};
  }
  Config old = config;
  auto applied = apply_yaml(config, text.str(), path);
  // Relative paths refer to the folder of the configuration file, so that a recording can be moved.
  const std::vector<std::string*> old_names = named_files(old);
  const std::vector<std::string*> names = named_files(config);
  for (std::size_t i = 0; i < names.size(); ++i) {
    const bool is_new = *names[i] != *old_names[i] && !names[i]->empty();
    if (is_new && std::filesystem::path(*names[i]).is_relative())
      *names[i] = (std::filesystem::path(path).parent_path() / *names[i]).string();
  }
  return applied;
}

Result<std::monostate> apply_override(Config& config, const std::string& assignment) {
  const auto equals = assignment.find('=');
  const std::string name = "--set " + assignment;
  if (equals == std::string::npos || equals == 0)
    return Error{name + ": expected key=value, such as odometry.threads=2"};
  Loader loader(config, name);
  try {
    const std::string value = assignment.substr(equals + 1);
    loader.apply(value.empty() ? YAML::Node(std::string()) : YAML::Load(value), assignment.substr(0, equals));
  } catch (const YAML::Exception& exception) {
    return Error{name + ": the value is not YAML: " + exception.msg};
  }
  return loader.result();
}

Result<std::monostate> apply_overrides(Config& config, const std::vector<std::string>& assignments) {
  for (const std::string& assignment : assignments) {
    if (auto applied = apply_override(config, assignment); !applied) return applied;
  }
  return std::monostate{};
}

namespace {

struct Emit {
  YAML::Emitter& out;
  void operator()(const std::string* value) const { out << YAML::DoubleQuoted << *value; }
  template <class Scalar>
  void operator()(const Scalar* value) const {
    out << *value;
  }
  template <class Item>
  void operator()(const std::vector<Item>* value) const {
    out << YAML::Flow << *value;
  }
};

std::string choices_text(const ConfigKey& key) {
  std::string text;
  for (const std::string& choice : key.allowed) text += (text.empty() ? "" : ", ") + choice;
  return text;
}

/// One-line description of a key: meaning, range or unit, choices.
std::string comment_text(const ConfigKey& key) {
  std::string text = key.help;
  const std::string range = range_text(key);
  if (!range.empty()) text += "; " + range;
  if (range.empty() && !key.unit.empty()) text += "; " + key.unit;
  if (!key.allowed.empty()) text += "; one of " + choices_text(key);
  return text;
}

/// Emits the keys below `prefix` as a map. The table keeps the keys of a section adjacent.
std::size_t emit_section(YAML::Emitter& out, const std::vector<ConfigKey>& keys, std::size_t i,
                         const std::string& prefix) {
  out << YAML::BeginMap;
  while (i < keys.size() && keys[i].path.starts_with(prefix)) {
    const std::string rest = keys[i].path.substr(prefix.size());
    const auto dot = rest.find('.');
    out << YAML::Key << rest.substr(0, dot) << YAML::Value;
    if (dot == std::string::npos) {
      std::visit(Emit{out}, keys[i].target);
      out << YAML::Comment(comment_text(keys[i]));
      ++i;
    } else {
      i = emit_section(out, keys, i, prefix + rest.substr(0, dot + 1));
    }
  }
  out << YAML::EndMap;
  return i;
}

}  // namespace

std::string value_text(const ConfigKey& key) {
  YAML::Emitter out;
  out.SetDoublePrecision(12);
  std::visit(Emit{out}, key.target);
  return out.c_str();
}

std::string to_yaml(Config config) {
  std::vector<ConfigKey> keys = config_keys(config);
  std::string left_out;
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i) {
    if (config.more_lidars[i].enabled) continue;
    const std::string section = extra_lidar_section(i);
    std::erase_if(keys, [&](const ConfigKey& key) { return key.path.starts_with(section + "."); });
    left_out += (left_out.empty() ? "# " : ", ") + section;
  }
  YAML::Emitter out;
  out.SetDoublePrecision(12);
  emit_section(out, keys, 0, "");
  if (!left_out.empty())
    left_out += ": off; keys: enabled, wait_ms and those of lidar except cut_azimuth_deg and min_coverage\n";
  return std::string(out.c_str()) + "\n" + left_out;
}

std::string describe_keys() {
  Config defaults;
  std::string text;
  for (const ConfigKey& key : config_keys(defaults)) {
    text += key.path + ": " + value_text(key) + "\n    " + comment_text(key) + " (" + type_text(key) + ")\n";
  }
  return text;
}

std::string config_reference() {
  Config defaults;
  std::string text =
      "# Configuration keys\n\nGenerated by `niliod --print-config-reference`. Later sources win: built-in "
      "defaults, defaults of the kind of recording,\n`nilio.yaml` beside the recording, `--config FILE`, "
      "`--set key=value`.\n\nSections `lidar2`, `lidar3` and `lidar4` add further LiDARs. They have the keys "
      "of "
      "`lidar` except `cut_azimuth_deg` and\n`min_coverage`, and those listed under `lidar2`.\n";
  std::string section;
  for (const ConfigKey& key : config_keys(defaults)) {
    const std::string own = key.path.substr(0, key.path.find('.'));
    if (own == extra_lidar_section(1) || own == extra_lidar_section(2)) continue;
    const std::string name = key.path.substr(own.size() + 1);
    if (own == extra_lidar_section(0) && name != "enabled" && name != "wait_ms") continue;
    if (std::exchange(section, own) != own)
      text += "\n## " + own +
              "\n\n| key | default | unit | range or choices | meaning |\n|---|---|---|---|---|\n";
    const std::string range =
        key.minimum == key.maximum ? choices_text(key) : number(key.minimum) + " to " + number(key.maximum);
    text += "| `" + name + "` | `" + value_text(key) + "` | " + key.unit + " | " + range + " | " + key.help +
            " |\n";
  }
  return text;
}

}  // namespace nilio::daemon
