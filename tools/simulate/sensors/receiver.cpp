#include "tools/simulate/sensors/receiver.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace nilio::tools::simulate {

namespace {

/// Surfaces closer together than the pulse is long give one echo.
constexpr double kPulseM = 0.75;
/// Delay of a weak partial echo in its time to cross the threshold, per natural logarithm of its share: the
/// leading edge of a pulse of 5 ns.
constexpr double kWalkM = 0.10;
/// Shots that find no echo for reasons of the surface, measured as interior holes of KITTI's scans.
constexpr double kLostOnGround = 0.0012;
constexpr double kLostElsewhere = 0.009;
/// Shots that report the light of another sensor.
constexpr double kTypicalGhosts = 3e-5;
constexpr double kPoorGhosts = 1e-3;
constexpr double kNearestGhostM = 2.0;

bool is_ground(Material material) {
  return material == Material::kAsphalt || material == Material::kPavement || material == Material::kGrass;
}

/// Reflected share of the light that falls on a surface at an angle.
double reflected(Material material, double cosine) {
  const double rho = reflectivity(material);
  switch (material) {
    case Material::kGlass:
      // A mirror: light returns only at normal incidence, and a little from dust, curtains and frames.
      return cosine > 0.998 ? 0.5 : 0.06 * cosine;
    case Material::kCarPaint:
    case Material::kMetal:
      return rho * (0.08 + 0.92 * cosine);
    default:
      // Rough surfaces reflect some light also at grazing incidence.
      return rho * (0.25 + 0.75 * cosine);
  }
}

}  // namespace

/// Light that arrives together.
struct Receiver::Light {
  double range_m = 0.0;
  /// Including the share of the footprint.
  double reflectance = 0.0;
  /// Of the surface if it filled the footprint.
  double full_reflectance = 0.0;
  double cosine = 1.0;
  double share = 0.0;
  Material material = Material::kAsphalt;
};

Receiver::Receiver(const drivers::VelodyneSensor& sensor, LidarErrors errors, const Weather& weather,
                   double range_noise_m)
    : errors_(std::move(errors)),
      weather_(weather),
      optics_(optics_of(sensor.model)),
      resolution_m_(sensor.distance_resolution_m),
      range_noise_m_(range_noise_m),
      reports_reflectivity_(!is_hdl64e(sensor.model)) {}

Returns Receiver::receive(std::span<const PartialHit> parts, const ReceivedShot& shot) const {
  std::array<Light, kFootprintRays + 1> lights;
  std::size_t count = 0;
  for (const PartialHit& part : parts) {
    if (!part.hit.hit || count == lights.size()) continue;
    const auto cosine = static_cast<double>(part.hit.incidence_cosine);
    double full = reflected(part.hit.material, cosine);
    if (is_ground(part.hit.material)) full *= weather_.ground_reflectivity;
    lights[count++] = {static_cast<double>(part.hit.distance_m),
                       full * part.share,
                       full,
                       cosine,
                       part.share,
                       part.hit.material};
  }
  // Insertion: few, and mostly in order.
  for (std::size_t i = 1; i < count; ++i)
    for (std::size_t k = i; k > 0 && lights[k].range_m < lights[k - 1].range_m; --k)
      std::swap(lights[k], lights[k - 1]);
  Returns returns;
  if (const auto air = weather_.air_echo(mix_bits(shot.word ^ 11U));
      air && (count == 0 || lights[0].range_m > *air)) {
    const Light drop{*air, 0.05, 0.05, 1.0, 1.0, Material::kFoliage};
    detect(drop, shot, mix_bits(shot.word ^ 12U), returns);
  }
  for (std::size_t i = 0; i < count;) {
    // Weighted mean of the surfaces within one pulse of the first.
    Light merged = lights[i];
    double moment = merged.range_m * merged.reflectance;
    std::size_t end = i + 1;
    for (; end < count && lights[end].range_m - lights[i].range_m < kPulseM; ++end) {
      moment += lights[end].range_m * lights[end].reflectance;
      if (lights[end].reflectance > merged.reflectance) merged.material = lights[end].material;
      merged.reflectance += lights[end].reflectance;
      merged.cosine = std::max(merged.cosine, lights[end].cosine);
      merged.share += lights[end].share;
    }
    if (merged.reflectance > 0.0) {
      merged.range_m = moment / merged.reflectance;
      detect(merged, shot, mix_bits(shot.word ^ (17U + i)), returns);
    }
    i = end;
  }
  if (!errors_.effects().has(Effect::kGhosts)) return returns;
  const double ghosts = errors_.realism() == Realism::kPoor ? kPoorGhosts : kTypicalGhosts;
  const std::uint64_t word = mix_bits(shot.word ^ 13U);
  if (to_unit_interval(word) < ghosts) {
    returns.count = 0;
    const double range =
        kNearestGhostM + (optics_.max_range_m - kNearestGhostM) * to_unit_interval(mix_bits(word));
    add_entry(range, {range, 0.05, 0.05, 1.0, 1.0, Material::kMetal}, 1.0, shot, word, returns);
  }
  return returns;
}

void Receiver::detect(const Light& light, const ReceivedShot& shot, std::uint64_t word,
                      Returns& returns) const {
  const Effects& effects = errors_.effects();
  const double passes = shot.transmission * std::exp(-2.0 * weather_.attenuation * light.range_m);
  const double limit = optics_.dark_range_m * std::sqrt(light.reflectance * passes / 0.1);
  double signal = limit / light.range_m;
  signal *= signal;
  if (light.range_m > optics_.max_range_m) return;
  if (effects.has(Effect::kDetection)) {
    const double lost = is_ground(light.material) ? kLostOnGround : kLostElsewhere;
    if (to_unit_interval(mix_bits(word ^ 1U)) < lost) return;
    if (to_unit_interval(mix_bits(word ^ 2U)) > detection_probability(signal)) return;
  } else {
    // As the ideal sensor: a threshold at random within 10 %.
    const double fading = 0.9 + 0.2 * to_unit_interval(mix_bits(word ^ 1U));
    if (signal * fading * fading < 1.0) return;
  }
  double range = light.range_m + errors_.range_error_m(shot.laser, shot.time);
  if (effects.has(Effect::kIncidence)) range -= incidence_shortening_m(light.range_m, light.cosine);
  if (effects.has(Effect::kFootprint) && light.share < 0.999) range -= kWalkM * std::log(light.share);
  const double noise = effects.has(Effect::kNoise) ? errors_.noise_m(light.range_m, light.reflectance) *
                                                         LidarErrors::noise_deviate(word)
                                                   : range_noise_m_ * to_gaussian(word);
  add_entry(range + noise, light, signal, shot, word, returns);
}

void Receiver::add_entry(double range_m, const Light& light, double signal, const ReceivedShot& shot,
                         std::uint64_t word, Returns& returns) const {
  if (returns.count == Returns::kCapacity) return;
  const double distance = shot.nominal->distance_for(range_m, shot.azimuth);
  const double raw = std::round((distance - shot.nominal->far_correction_m()) / resolution_m_);
  if (raw < 1.0 || raw > 65535.0) return;
  returns.echoes[returns.count] = {range_m, light.reflectance, std::max(1.0, signal)};
  returns.entries[returns.count] = {static_cast<std::uint16_t>(raw),
                                    intensity(light.reflectance, shot, raw, word)};
  ++returns.count;
}

std::uint8_t Receiver::intensity(double reflectance, const ReceivedShot& shot, double raw,
                                 std::uint64_t word) const {
  const double speckle = to_gaussian(mix_bits(word ^ 5U));
  if (reports_reflectivity_ || !errors_.effects().has(Effect::kDetection)) {
    const double value = std::clamp(100.0 * reflectance * (1.0 + 0.1 * speckle), 1.0, 255.0);
    return shot.nominal->raw_intensity(value, raw);
  }
  // HDL-64E: automatic gain makes the byte nearly independent of the reflectivity; statistics of KITTI's
  // scans.
  constexpr double kZeroShare = 0.11;
  if (to_unit_interval(mix_bits(word ^ 6U)) < kZeroShare) return shot.nominal->raw_intensity(0.0, raw);
  const double value = 76.0 * std::pow(std::max(reflectance, 0.01) / 0.2, 0.2) + 22.0 * speckle;
  return shot.nominal->raw_intensity(std::clamp(value, 1.0, 255.0), raw);
}

}  // namespace nilio::tools::simulate
