#include "tools/simulate/sensors/weather.hpp"

#include "tools/simulate/random.hpp"

#include <charconv>
#include <cmath>
#include <string_view>

namespace nilio::tools::simulate {

namespace {

constexpr double kWetGround = 0.3;

/// Marshall-Palmer drops with an extinction efficiency of 2: 2 % of the light is lost over 30 m and back at
/// 10 mm/h. Goodin's coefficient is 25 times larger and not used.
Weather rain(double mm_per_h) {
  Weather weather;
  weather.attenuation = 0.00036 * std::pow(mm_per_h, 0.63);
  // Large drops near the sensor, LISA (arXiv 2107.07004): about 0.3 % of the shots at 10 mm/h.
  weather.echoes_per_m = 0.0003 * std::pow(mm_per_h / 10.0, 0.63);
  weather.echo_range_m = 12.0;
  weather.ground_reflectivity = kWetGround;
  return weather;
}

/// Koschmieder's law with a contrast of 5 %; the echo from the air within a few metres (Hahner et al. 2021).
Weather haze(double visibility_m, double echo_share) {
  Weather weather;
  weather.attenuation = std::log(20.0) / visibility_m;
  weather.echoes_per_m = echo_share * weather.attenuation;
  weather.echo_range_m = 15.0;
  return weather;
}

}  // namespace

std::optional<double> Weather::air_echo(std::uint64_t word) const {
  if (echoes_per_m <= 0.0) return std::nullopt;
  const double range_m = -std::log(1.0 - to_unit_interval(word)) / echoes_per_m;
  if (range_m > echo_range_m || range_m < 1.0) return std::nullopt;
  return range_m;
}

core::Result<Weather> parse_weather(const std::string& text) {
  if (text.empty() || text == "clear") return Weather{};
  if (text == "wet") {
    Weather weather;
    weather.ground_reflectivity = kWetGround;
    return weather;
  }
  const std::string_view view = text;
  const std::size_t equals = view.find('=');
  const std::string_view kind = view.substr(0, equals);
  double value = 0.0;
  bool number = false;
  if (equals != std::string_view::npos) {
    const std::string_view digits = view.substr(equals + 1);
    const auto parsed = std::from_chars(digits.data(), digits.data() + digits.size(), value);
    number = parsed.ec == std::errc() && parsed.ptr == digits.data() + digits.size();
  }
  if (number && kind == "rain" && value > 0.0 && value <= 200.0) return rain(value);
  if (number && kind == "fog" && value >= 10.0 && value <= 10000.0) return haze(value, 0.05);
  if (number && kind == "dust" && value >= 10.0 && value <= 10000.0) return haze(value, 0.2);
  return core::Error{"--weather: '" + text +
                     "' is not weather - give clear, wet, rain=MM_PER_H (up to 200), fog=VISIBILITY_M or "
                     "dust=VISIBILITY_M (10 to 10000)"};
}

}  // namespace nilio::tools::simulate
