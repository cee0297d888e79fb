#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"

#include <cstdint>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

namespace nilio::daemon {

/// Who needs a key: everybody who installs nilio on a vehicle, or whoever tunes it.
enum class KeyLevel : std::uint8_t { kBasic, kAdvanced };

/// Effect of a changed key on a running niliod that reads its configuration again.
enum class ReloadClass : std::uint8_t {
  kApplied,  ///< takes effect at once
  kRestart,  ///< takes effect when niliod is restarted
};

/// One configuration key: its path, its target variable and its allowed values. This table is the only list
/// of keys; loading, overriding, printing and documentation use it.
struct ConfigKey {
  using Target =
      std::variant<bool*, int*, double*, std::string*, std::vector<double>*, std::vector<std::string>*>;

  std::string path;  ///< "odometry.threads"
  Target target;
  std::string help;
  std::string unit{};  ///< empty = dimensionless
  double minimum = 0.0;
  double maximum = 0.0;                ///< numbers only; minimum == maximum: any finite number
  std::vector<std::string> allowed{};  ///< choices of a text key; empty = any text
  KeyLevel level = KeyLevel::kAdvanced;
  ReloadClass reload = ReloadClass::kRestart;
};

/// Section name of Config::more_lidars[index]: "lidar2" for index 0.
std::string extra_lidar_section(std::size_t index);

/// All keys, bound to the members of `config`.
std::vector<ConfigKey> config_keys(Config& config);

/// Origins in ConfigSources: of `--set`, and the beginning of those of environment variables.
inline constexpr std::string_view kOptionOrigin = "--set";
inline constexpr std::string_view kVariablePrefix = "NILIO_";

/// "5 to 300 m"; empty for a key that is no number, or any finite one.
std::string range_text(const ConfigKey& key);
/// Type and range of the key: "a number from 5 to 300 m", "one of auto, on, off".
std::string type_text(const ConfigKey& key);
/// Value of the key as YAML on one line.
std::string value_text(const ConfigKey& key);
/// Environment variable that overrides the key: "NILIO_LIDAR_PORT".
std::string environment_name(const ConfigKey& key);

/// Applies a YAML file to `config`. The error lists all problems with file and line: unknown keys with the
/// nearest known keys, keys given twice, wrong types, values out of range.
core::Result<std::monostate> apply_file(Config& config, const std::string& path);
/// Same as apply_file() for text; `name` replaces the file name in messages.
core::Result<std::monostate> apply_yaml(Config& config, const std::string& text, const std::string& name);
/// Applies the variables NILIO_SECTION_KEY of an environment such as environ(7): texts "NAME=value", the last
/// one null. Other variables with this prefix that resemble a key become a warning in `config.sources`.
core::Result<std::monostate> apply_environment(Config& config, const char* const* environment);
/// Applies one assignment such as "odometry.threads=2".
core::Result<std::monostate> apply_override(Config& config, const std::string& assignment);
/// Applies the assignments in order and stops at the first error.
core::Result<std::monostate> apply_overrides(Config& config, const std::vector<std::string>& assignments);

/// Effective configuration as YAML that apply_yaml() reads back unchanged. Disabled additional LiDARs are
/// listed in a comment only.
std::string to_yaml(const Config& config);
/// Same as to_yaml(), with the origin of each value as comment.
std::string to_yaml_with_origins(const Config& config);
/// One line for the log: the files that were read, the overridden keys, and config_hash().
std::string describe_sources(const Config& config);
/// All keys with default, meaning, type and range, for `niliod --help-config`.
std::string describe_keys();
/// The generated files: `niliod --print-config-reference` prints them, tests compare them.
std::string reference_yaml();      ///< config/reference.yaml
std::string reference_markdown();  ///< docs/configuration.md
std::string reference_schema();    ///< config/nilio.schema.json: JSON Schema, draft 7

/// Key whose value differs between two configurations.
struct ConfigChange {
  std::string key;   ///< "log.level"
  std::string from;  ///< earlier value as YAML on one line
  std::string to;    ///< later value as YAML on one line
  ReloadClass reload = ReloadClass::kRestart;
};

/// Keys whose values differ, in the order of the table; empty if both configurations have the same effect.
std::vector<ConfigChange> find_changes(const Config& from, const Config& to);

/// Hash of all effective values (FNV-1a, 64 bit, as 16 hexadecimal digits). The same for the same values,
/// however they were given: file, environment, command line or default.
std::string config_hash(const Config& config);

}  // namespace nilio::daemon
