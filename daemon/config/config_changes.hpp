#pragma once

#include "daemon/config/schema.hpp"

#include <string>
#include <vector>

namespace nilio::daemon {

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
