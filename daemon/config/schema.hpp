#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"

#include <cstdint>
#include <string>
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

/// Applies a YAML file to `config`. The error lists all problems with file and line: unknown keys with the
/// nearest known key, wrong types, values out of range.
core::Result<std::monostate> apply_file(Config& config, const std::string& path);
/// Same as apply_file() for text; `name` replaces the file name in messages.
core::Result<std::monostate> apply_yaml(Config& config, const std::string& text, const std::string& name);
/// Value of the key as YAML on one line.
std::string value_text(const ConfigKey& key);

/// Applies one assignment such as "odometry.threads=2".
core::Result<std::monostate> apply_override(Config& config, const std::string& assignment);
/// Applies the assignments in order and stops at the first error.
core::Result<std::monostate> apply_overrides(Config& config, const std::vector<std::string>& assignments);

/// Effective configuration as YAML that apply_yaml() reads back unchanged. Disabled additional LiDARs are
/// listed in a comment only.
std::string to_yaml(Config config);
/// All keys with type, default, unit, range and meaning, for `niliod --help-config`.
std::string describe_keys();
/// All keys as Markdown tables, for `niliod --print-config-reference`; docs/configuration.md is this text.
std::string config_reference();

}  // namespace nilio::daemon
