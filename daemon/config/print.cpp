#include "daemon/config/schema.hpp"

#include <algorithm>
#include <cctype>
#include <functional>
#include <iomanip>
#include <map>
#include <sstream>
#include <utility>

#include <yaml-cpp/yaml.h>

namespace nilio::daemon {

namespace {

std::string number(double value) {
  std::ostringstream out;
  out << std::setprecision(10) << value;
  return out.str();
}

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

using CommentOf = std::function<std::string(const ConfigKey&)>;

/// Emits the keys below `prefix` as a map. The table keeps the keys of a section adjacent.
std::size_t emit_section(YAML::Emitter& out, const std::vector<ConfigKey>& keys, std::size_t i,
                         const std::string& prefix, const CommentOf& comment_of) {
  out << YAML::BeginMap;
  while (i < keys.size() && keys[i].path.starts_with(prefix)) {
    const std::string rest = keys[i].path.substr(prefix.size());
    const auto dot = rest.find('.');
    out << YAML::Key << rest.substr(0, dot) << YAML::Value;
    if (dot == std::string::npos) {
      std::visit(Emit{out}, keys[i].target);
      out << YAML::Comment(comment_of(keys[i]));
      ++i;
    } else {
      i = emit_section(out, keys, i, prefix + rest.substr(0, dot + 1), comment_of);
    }
  }
  out << YAML::EndMap;
  return i;
}

}  // namespace

std::string range_text(const ConfigKey& key) {
  if (key.minimum == key.maximum) return "";
  return number(key.minimum) + " to " + number(key.maximum) + (key.unit.empty() ? "" : " " + key.unit);
}

std::string type_text(const ConfigKey& key) {
  struct Name {
    const ConfigKey& key;

    std::string operator()(bool*) const { return "true or false"; }
    std::string operator()(int*) const { return "a whole number"; }
    std::string operator()(double*) const { return "a number"; }
    std::string operator()(std::string*) const {
      std::string choices;
      for (const std::string& choice : key.allowed) choices += (choices.empty() ? "" : ", ") + choice;
      return choices.empty() ? "text" : "one of " + choices;
    }
    std::string operator()(std::vector<double>*) const { return "a list of three numbers"; }
    std::string operator()(std::vector<std::string>*) const { return "a list of texts"; }
  };
  const std::string type = std::visit(Name{key}, key.target);
  const std::string range = range_text(key);
  if (!range.empty()) return type + " from " + range;
  return key.unit.empty() ? type : type + " in " + key.unit;
}

std::string value_text(const ConfigKey& key) {
  YAML::Emitter out;
  out.SetDoublePrecision(12);
  std::visit(Emit{out}, key.target);
  return out.c_str();
}

std::string environment_name(const ConfigKey& key) {
  std::string name = std::string(kVariablePrefix) + key.path;
  std::ranges::transform(name, name.begin(),
                         [](unsigned char c) { return c == '.' ? '_' : static_cast<char>(std::toupper(c)); });
  return name;
}

namespace {

/// One-line description of a key: meaning, range or unit, choices.
std::string comment_text(const ConfigKey& key) {
  std::string text = key.help;
  const std::string range = range_text(key);
  if (!range.empty()) text += "; " + range;
  if (range.empty() && !key.unit.empty()) text += "; " + key.unit;
  if (!key.allowed.empty()) text += "; " + type_text(key);
  return text;
}

std::string yaml_of(const std::vector<ConfigKey>& keys, const CommentOf& comment_of) {
  YAML::Emitter out;
  out.SetDoublePrecision(12);
  emit_section(out, keys, 0, "", comment_of);
  return std::string(out.c_str()) + "\n";
}

/// Keys of the sections that have an effect, and a comment about the others.
std::string effective_yaml(Config config, const CommentOf& comment_of) {
  std::vector<ConfigKey> keys = config_keys(config);
  std::string left_out;
  for (std::size_t i = 0; i < kMaxExtraLidars; ++i) {
    if (config.more_lidars[i].enabled) continue;
    const std::string section = extra_lidar_section(i);
    std::erase_if(keys, [&](const ConfigKey& key) { return key.path.starts_with(section + "."); });
    left_out += (left_out.empty() ? "# " : ", ") + section;
  }
  if (!left_out.empty())
    left_out += ": off; keys: enabled, wait_ms and those of lidar except cut_azimuth_deg and min_coverage\n";
  return yaml_of(keys, comment_of) + left_out;
}

}  // namespace

std::string to_yaml(const Config& config) { return effective_yaml(config, comment_text); }

std::string to_yaml_with_origins(const Config& config) {
  Config defaults;
  std::map<std::string, std::string> default_of;
  for (const ConfigKey& key : config_keys(defaults)) default_of[key.path] = value_text(key);
  return effective_yaml(config, [&](const ConfigKey& key) {
    const auto origin = config.sources.origin_of.find(key.path);
    if (origin != config.sources.origin_of.end()) return origin->second;
    return std::string(value_text(key) == default_of[key.path] ? "default" : "recording");
  });
}

std::string describe_sources(const Config& config) {
  std::string files;
  std::string variables;
  std::string options;
  const auto list = [](std::string& text, const std::string& name) {
    text += (text.empty() ? "" : ", ") + name;
  };
  for (const std::string& file : config.sources.files) list(files, file);
  for (const auto& [key, origin] : config.sources.origin_of) {
    if (origin == kOptionOrigin) list(options, key);
    if (origin.starts_with(kVariablePrefix)) list(variables, origin);
  }
  std::string text = "configuration: " + (files.empty() ? "no file" : files);
  if (!variables.empty()) text += "; environment " + variables;
  if (!options.empty()) text += "; " + std::string(kOptionOrigin) + " " + options;
  return text + "; hash " + config_hash(config);
}

std::string describe_keys() {
  Config defaults;
  std::string text;
  for (const ConfigKey& key : config_keys(defaults)) {
    text += key.path + ": " + value_text(key) + "\n    " + key.help + " (" + type_text(key) + ")\n";
  }
  return text;
}

std::string reference_yaml() {
  Config defaults;
  std::vector<ConfigKey> keys = config_keys(defaults);
  std::erase_if(keys, [](const ConfigKey& key) {
    return key.path.starts_with(extra_lidar_section(1)) || key.path.starts_with(extra_lidar_section(2));
  });
  return "# yaml-language-server: $schema=nilio.schema.json\n"
         "# Every key of niliod with its default. Copy the keys to change into the file for --config.\n"
         "# Sections lidar3 and lidar4 have the keys of lidar2.\n"
         "# Generated by: niliod --print-config-reference yaml\n" +
         yaml_of(keys, comment_text);
}

}  // namespace nilio::daemon
