#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"

#include <string>
#include <variant>
#include <vector>

namespace nilio::daemon {

/// One configuration key: where it lives, what it takes. This table is the only list of keys: loading,
/// overriding, printing and documenting all read it.
struct ConfigKey {
  using Target =
      std::variant<bool*, int*, double*, std::string*, std::vector<double>*, std::vector<std::string>*>;

  std::string path;  ///< "odometry.threads"
  Target target;
  std::string help;
  std::string unit;  ///< empty when there is none
  double minimum = 0.0;
  double maximum = 0.0;              ///< numbers only; minimum == maximum: any finite number
  std::vector<std::string> allowed;  ///< strings only; empty: any
};

/// "lidar2" for 0, the section of Config::more_lidars[index].
std::string extra_lidar_section(std::size_t index);

/// The keys, bound to the members of `config`.
std::vector<ConfigKey> config_keys(Config& config);

/// Applies a YAML file on top of `config`. All problems are in the one error: unknown keys with the nearest
/// known one, wrong types, values out of range with the range and unit, each with file and line.
core::Result<std::monostate> apply_file(Config& config, const std::string& path);
/// Same, from text; `name` stands for the file in messages.
core::Result<std::monostate> apply_yaml(Config& config, const std::string& text, const std::string& name);
/// What the key holds, as YAML on one line.
std::string value_text(const ConfigKey& key);

/// "odometry.threads=2".
core::Result<std::monostate> apply_override(Config& config, const std::string& assignment);
/// One after the other, up to the first that is wrong.
core::Result<std::monostate> apply_overrides(Config& config, const std::vector<std::string>& assignments);

/// The effective configuration as YAML that apply_yaml takes back unchanged. LiDARs that are off are left out
/// but for a comment.
std::string to_yaml(Config config);
/// All keys with type, default, unit, range and meaning, for `niliod --help-config`.
std::string describe_keys();

}  // namespace nilio::daemon
