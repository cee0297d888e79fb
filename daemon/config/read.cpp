#include "nilio/drivers/common/nearest_name.hpp"

#include "daemon/config/schema.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iomanip>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <string_view>
#include <system_error>
#include <type_traits>
#include <utility>

#include <yaml-cpp/yaml.h>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

/// Maximum number of keys that a message offers for a misspelt one; more are no help.
constexpr std::size_t kMaxNeighbours = 5;

std::string last_name(const std::string& path) { return path.substr(path.rfind('.') + 1); }

/// True if every word of `wanted` begins a word of `name`: "rotation" and "rpy_rot" fit "rotation_rpy_deg".
bool abbreviates(const std::string& wanted, const std::string& name) {
  std::istringstream words(wanted);
  for (std::string word; std::getline(words, word, '_');) {
    if (word.empty() || ("_" + name).find("_" + word) == std::string::npos) return false;
  }
  return !wanted.empty();
}

/// Paths whose last name is meant by `wanted`: the same name, one that it abbreviates, or the nearest one.
std::vector<std::string> meant_paths(const std::string& wanted, const std::vector<std::string>& paths) {
  const auto select = [&](auto&& fits) {
    std::vector<std::string> result;
    std::ranges::copy_if(paths, std::back_inserter(result),
                         [&](const auto& path) { return fits(last_name(path)); });
    return result;
  };
  std::vector<std::string> same = select([&](const std::string& name) { return name == wanted; });
  if (!same.empty()) return same;
  std::vector<std::string> longer =
      select([&](const std::string& name) { return abbreviates(wanted, name); });
  if (!longer.empty() && longer.size() <= kMaxNeighbours) return longer;
  std::vector<std::string> names;
  for (const std::string& path : paths) names.push_back(last_name(path));
  const auto nearest = drivers::nearest_name(wanted, names);
  return nearest ? select([&](const std::string& name) { return name == *nearest; })
                 : std::vector<std::string>{};
}

/// End of the message about the unknown key `path`. `known`: keys and sections. A key of the same section is
/// meant before one further below, and that before one of another section.
std::string nearest_key_hint(const std::string& path, const std::vector<std::string>& known) {
  if (path == "output.map_voxel_m")
    return " - remove it: map.ply is the export of the map, nilio map export --spacing chooses its density";
  const std::string parent = path.substr(0, path.rfind('.') + 1);
  std::vector<std::string> siblings;
  std::vector<std::string> below;
  std::vector<std::string> anywhere;
  for (const std::string& other : known) {
    const bool in_extra_lidar = other.starts_with("lidar") && other.size() > 5 && other[5] != '.';
    if (other.starts_with(parent)) {
      const bool is_sibling = other.find('.', parent.size()) == std::string::npos;
      if (is_sibling || !in_extra_lidar || !parent.empty()) (is_sibling ? siblings : below).push_back(other);
    }
    if (!in_extra_lidar) anywhere.push_back(other);
  }
  std::vector<std::string> meant;
  for (const std::vector<std::string>* scope : {&siblings, &below, &anywhere}) {
    meant = meant_paths(last_name(path), *scope);
    if (meant.size() > kMaxNeighbours) meant.clear();
    if (meant.empty()) continue;
    const auto nearest = drivers::nearest_name(path, meant);
    if (scope == &anywhere && nearest) meant = {*nearest};
    break;
  }
  std::string text;
  for (std::size_t i = 0; i < meant.size(); ++i)
    text += (i == 0 ? " (did you mean '" : i + 1 < meant.size() ? ", '" : " or '") + meant[i] + "'";
  if (!text.empty()) return text + "?)";
  return " - niliod --help-config lists all keys";
}

/// False for texts that YAML 1.2 and its editors do not take for a number, but yaml-cpp does: quoted ones,
/// and leading zeros (octal).
bool is_plain_number(const YAML::Node& node) {
  const std::string& text = node.Scalar();
  const std::size_t first = text.find_first_not_of("+-");
  const bool has_leading_zero = first != std::string::npos && first + 1 < text.size() && text[first] == '0' &&
                                std::isdigit(static_cast<unsigned char>(text[first + 1])) != 0;
  return node.Tag() != "!" && !has_leading_zero;
}

/// Error text for a number out of range; empty if the number is allowed.
std::string check_number(const ConfigKey& key, double value) {
  const std::string range = range_text(key);
  const bool is_free = range.empty();
  if (std::isfinite(value) && (is_free || (value >= key.minimum && value <= key.maximum))) return "";
  std::ostringstream text;
  text << std::setprecision(10) << "is " << value << ", allowed is "
       << (is_free ? "any finite number" : range);
  return text.str();
}

/// Stores a YAML value in the key's target. Returns the error text, empty on success.
struct Store {
  const ConfigKey& key;
  const YAML::Node& node;

  [[nodiscard]] std::string wrong_type() const {
    const std::string text = "takes " + type_text(key) + ", not ";
    if (node.IsNull()) return text + "nothing";
    if (node.IsMap()) return text + "a section";
    if (node.IsSequence()) return text + "a list of " + std::to_string(node.size());
    return text + (node.Tag() == "!" ? "the text \"" + node.Scalar() + "\"" : "'" + node.Scalar() + "'");
  }
  /// bool, int or double.
  template <class Scalar>
  std::string operator()(Scalar* target) const {
    Scalar value{};
    if (!node.IsScalar() || !is_plain_number(node) || !YAML::convert<Scalar>::decode(node, value))
      return wrong_type();
    if constexpr (!std::is_same_v<Scalar, bool>) {
      if (std::string problem = check_number(key, value); !problem.empty()) return problem;
    }
    *target = value;
    return "";
  }
  std::string operator()(std::string* target) const {
    if (!node.IsScalar()) return wrong_type();
    const std::string value = node.Scalar();
    if (!key.allowed.empty() && std::ranges::find(key.allowed, value) == key.allowed.end()) {
      const auto nearest = drivers::nearest_name(value, key.allowed);
      return "is '" + value + "', allowed is " + type_text(key) +
             (nearest ? " (did you mean '" + *nearest + "'?)" : "");
    }
    *target = value;
    return "";
  }
  std::string operator()(std::vector<double>* target) const {
    if (!node.IsSequence() || node.size() != 3) return wrong_type();
    std::vector<double> values;
    for (const YAML::Node& element : node) {
      double value = 0.0;
      if (const std::string problem = Store{key, element}(&value); !problem.empty()) return problem;
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

/// Applies the values of one file, variable or option, and collects the problems.
class Loader {
 public:
  Loader(Config& config, std::string name)
      : sources_(config.sources), keys_(config_keys(config)), name_(std::move(name)) {
    std::set<std::string> sections;
    for (const ConfigKey& key : keys_) {
      for (auto dot = key.path.find('.'); dot != std::string::npos; dot = key.path.find('.', dot + 1)) {
        if (sections.insert(key.path.substr(0, dot)).second) known_.push_back(key.path.substr(0, dot));
      }
      known_.push_back(key.path);
    }
  }

  /// `line`: that of the key, from 1; 0 where the source has no lines.
  void apply(const YAML::Node& node, const std::string& path, int line) {
    const std::string place = line == 0 ? name_ : name_ + ":" + std::to_string(line);
    const auto key = std::ranges::find(keys_, path, &ConfigKey::path);
    if (key != keys_.end()) {
      const std::string problem = std::visit(Store{*key, node}, key->target);
      if (!problem.empty()) add_problem(place, path + " " + problem);
      sources_.origin_of[path] = place;
    } else if (std::ranges::find(known_, path) == known_.end()) {
      add_problem(place, "unknown key '" + path + "'" + nearest_key_hint(path, known_));
    } else if (node.IsMap()) {
      for (const auto& entry : node) apply_entry(entry.first, entry.second, path);
    } else if (!node.IsNull()) {
      add_problem(place, "'" + path + "' is a section and takes keys below it");
    }
  }

  void apply_entry(const YAML::Node& key, const YAML::Node& value, const std::string& parent) {
    const std::string name = key.IsScalar() ? key.Scalar() : "?";
    const std::string path = parent.empty() ? name : parent + "." + name;
    const int line = key.Mark().line + 1;
    const auto [first, is_new] = lines_.emplace(path, line);
    if (!is_new)
      add_problem(name_ + ":" + std::to_string(line), "'" + path + "' is already given in line " +
                                                          std::to_string(first->second) +
                                                          " - remove one of them");
    apply(value, path, line);
  }

  [[nodiscard]] Result<std::monostate> result() const {
    if (problems_.empty()) return std::monostate{};
    return Error{problems_};
  }

 private:
  void add_problem(const std::string& place, const std::string& text) {
    problems_ += (problems_.empty() ? "" : "\n") + place + ": " + text;
  }

  ConfigSources& sources_;
  std::vector<ConfigKey> keys_;
  /// Keys and sections.
  std::vector<std::string> known_;
  std::string name_;
  std::string problems_;
  /// First line of each key and section.
  std::map<std::string, int> lines_;
};

/// Applies one value of a variable or an option; `name` is its origin.
Result<std::monostate> apply_value(Config& config, const std::string& name, const std::string& path,
                                   const std::string& value) {
  Loader loader(config, name);
  try {
    loader.apply(value.empty() ? YAML::Node(std::string()) : YAML::Load(value), path, 0);
  } catch (const YAML::Exception& exception) {
    return Error{name + ": " + path + ": the value '" + value + "' is not YAML: " + exception.msg};
  }
  return loader.result();
}

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
  config.sources.files.push_back(path);
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

Result<std::monostate> apply_environment(Config& config, const char* const* environment) {
  std::map<std::string, std::string> path_of;
  std::vector<std::string> names;
  for (const ConfigKey& key : config_keys(config)) {
    names.push_back(environment_name(key));
    path_of[names.back()] = key.path;
  }
  for (; *environment != nullptr; ++environment) {
    const std::string_view variable = *environment;
    const std::size_t equals = variable.find('=');
    if (!variable.starts_with(kVariablePrefix) || equals == std::string_view::npos) continue;
    const std::string name(variable.substr(0, equals));
    if (const auto path = path_of.find(name); path != path_of.end()) {
      auto applied = apply_value(config, name, path->second, std::string(variable.substr(equals + 1)));
      if (!applied) return applied;
      continue;
    }
    const auto longer =
        std::ranges::find_if(names, [&](const auto& key) { return key.starts_with(name + "_"); });
    const auto nearest = longer != names.end() ? *longer : drivers::nearest_name(name, names);
    if (nearest)
      config.sources.warnings.push_back(
          name + ": is no key of the configuration, the variable has no effect (did you mean " + *nearest +
          "?)");
  }
  return std::monostate{};
}

Result<std::monostate> apply_override(Config& config, const std::string& assignment) {
  const auto equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0)
    return Error{"--set " + assignment + ": expected key=value, such as odometry.threads=2"};
  return apply_value(config, std::string(kOptionOrigin), assignment.substr(0, equals),
                     assignment.substr(equals + 1));
}

Result<std::monostate> apply_overrides(Config& config, const std::vector<std::string>& assignments) {
  for (const std::string& assignment : assignments) {
    if (auto applied = apply_override(config, assignment); !applied) return applied;
  }
  return std::monostate{};
}

}  // namespace nilio::daemon
