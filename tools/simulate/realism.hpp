#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tools::simulate {

/// How far sensors, vehicle and scene depart from ideal ones.
enum class Realism : std::uint8_t {
  kIdeal,    ///< calibrated sensor with white noise, solid objects, smooth body motion
  kTypical,  ///< a healthy unit on a usual car
  kPoor,     ///< an old or hot unit: twice the errors
};

/// Departures from the ideal that can be switched one by one.
enum class Effect : std::uint8_t {
  kNoise,        ///< range noise by range and reflectivity instead of one standard deviation
  kCalibration,  ///< range, elevation and azimuth errors of each laser, drawn for the unit; range drift
  kIncidence,    ///< ranges too short at grazing incidence
  kDetection,    ///< lost echoes, reflectivity texture, intensities
  kFootprint,    ///< width of the beam: mixed and partial echoes
  kRetro,        ///< halos of retroreflectors
  kGhosts,       ///< ranges from the light of other sensors
  kOwnVehicle,   ///< roof and rack hide ground
  kVegetation,   ///< crowns, hedges and grass that light enters
  kClutter,      ///< fences, wires, hedges, bins and boxes
  kGround,       ///< rough surfaces
  kVehicle,      ///< road roughness through the suspension, wheel hop, engine
  kImu,          ///< errors of the IMU's grade instead of four constants
};
inline constexpr std::size_t kEffectCount = 13;

/// A set of effects.
class Effects {
 public:
  static Effects none() { return {}; }
  static Effects all();
  [[nodiscard]] bool has(Effect effect) const { return (bits_ & bit(effect)) != 0; }
  void add(Effect effect) { bits_ |= bit(effect); }
  [[nodiscard]] bool empty() const { return bits_ == 0; }

 private:
  static std::uint32_t bit(Effect effect) { return 1U << static_cast<unsigned>(effect); }
  std::uint32_t bits_ = 0;
};

/// "noise", "calibration", ... in the order of Effect.
const std::vector<std::string>& effect_names();
/// Set of the named effects; the error lists the names.
core::Result<Effects> parse_effects(const std::vector<std::string>& names);

}  // namespace nilio::tools::simulate
