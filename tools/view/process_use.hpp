#pragma once

#include <optional>
#include <string>

namespace nilio::tools::view {

/// Use of the computer by a process, of /proc. Of several with the same name, their sum and the latest start.
struct ProcessUse {
  std::string name;
  double cpu_s = 0.0;
  double resident_bytes = 0.0;
  double start_unix_s = 0.0;
};

/// Of this program, as "nilio-view".
ProcessUse own_use();
/// Of the processes of this computer with this name; unset without one.
std::optional<ProcessUse> use_of(const std::string& name);

}  // namespace nilio::tools::view
