#include "tools/simulate/realism.hpp"

#include <algorithm>

namespace nilio::tools::simulate {

Effects Effects::all() {
  Effects effects;
  effects.bits_ = (1U << kEffectCount) - 1U;
  return effects;
}

const std::vector<std::string>& effect_names() {
  static const std::vector<std::string> names{
      "noise",       "calibration", "incidence", "detection", "footprint", "retro", "ghosts",
      "own_vehicle", "vegetation",  "clutter",   "ground",    "vehicle",   "imu"};
  return names;
}

core::Result<Effects> parse_effects(const std::vector<std::string>& names) {
  Effects effects;
  const std::vector<std::string>& known = effect_names();
  for (const std::string& name : names) {
    const auto found = std::find(known.begin(), known.end(), name);
    if (found == known.end()) {
      std::string list;
      for (const std::string& effect : known) list += (list.empty() ? "" : ", ") + effect;
      return core::Error{"--effects: '" + name + "' is not an effect - there are " + list};
    }
    effects.add(static_cast<Effect>(found - known.begin()));
  }
  return effects;
}

}  // namespace nilio::tools::simulate
