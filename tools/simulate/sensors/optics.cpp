#include "tools/simulate/sensors/optics.hpp"

#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

using drivers::VelodyneModel;

bool is_hdl64e(VelodyneModel model) {
  using enum VelodyneModel;
  return model == kHdl64eS1 || model == kHdl64eS2 || model == kHdl64eS21 || model == kHdl64eS3;
}

Optics optics_of(VelodyneModel model) {
  using enum VelodyneModel;
  if (is_hdl64e(model)) return {120.0, 50.0, 0.002, 0.002};
  switch (model) {
    case kVlp32a:
    case kVlp32b:
    case kVlp32c:
      return {200.0, 80.0, 0.003, 0.0015};
    case kVls128:
      return {245.0, 200.0, 0.003, 0.0015};
    default:
      return {};
  }
}

std::array<FootprintRay, kFootprintRays> footprint_rays(const Optics& optics, double turn_rad) {
  constexpr double kMiddleShare = 0.25;
  // The divergence is the full width at 1/e^2; the mean square radius of such a beam is half its radius
  // squared.
  const double radius = 0.5 * std::sqrt(0.5 / (1.0 - kMiddleShare));
  std::array<FootprintRay, kFootprintRays> rays;
  rays[0].share = kMiddleShare;
  for (std::size_t k = 1; k < kFootprintRays; ++k) {
    const double angle = turn_rad + std::numbers::pi / 3.0 * static_cast<double>(k);
    rays[k] = {radius * optics.divergence_rad * std::cos(angle),
               radius * optics.divergence_up_rad * std::sin(angle),
               (1.0 - kMiddleShare) / static_cast<double>(kFootprintRays - 1)};
  }
  return rays;
}

}  // namespace nilio::tools::simulate
