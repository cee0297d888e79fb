#include "drivers/bag/beams.hpp"

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

namespace nilio::drivers::bag {

namespace {

constexpr double kRadians = std::numbers::pi / 180.0;
// Sensors have 4 to 128 beams; merged clouds more.
constexpr std::size_t kMaxBeams = 1024;
constexpr std::size_t kPointsPerCloud = 20'000;
// Smaller angles lie within a beam: divergence, noise, calibration.
constexpr double kSmallestSpacing = 0.03 * kRadians;
constexpr double kSector = 0.5 * kRadians;
constexpr double kDefaultSpacing = 0.4 * kRadians;

/// Elevations of the points of one beam.
struct Elevations {
  std::size_t points = 0;
  double sum = 0.0;
  double squares = 0.0;
  void add(double elevation) {
    ++points;
    sum += elevation;
    squares += elevation * elevation;
  }
  [[nodiscard]] double mean() const { return sum / static_cast<double>(points); }
  [[nodiscard]] double deviation() const {
    return std::sqrt(std::max(squares / static_cast<double>(points) - mean() * mean(), 0.0));
  }
};
using ElevationsOfBeams = std::map<std::uint32_t, Elevations>;

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double elevation_of(const std::array<float, 3>& p) {
  return portable::atan2(static_cast<double>(p[2]),
                         std::sqrt(static_cast<double>(p[0]) * static_cast<double>(p[0]) +
                                   static_cast<double>(p[1]) * static_cast<double>(p[1])));
}

/// Elevations by the number that `number_of(cloud, index)` gives a point.
ElevationsOfBeams collect(std::span<const CloudCopy> clouds, const PositionColumns& columns,
                          const std::function<std::uint32_t(const CloudView&, std::size_t)>& number_of) {
  ElevationsOfBeams beams;
  for (const CloudCopy& cloud : clouds) {
    const CloudView& view = cloud.view;
    // A prime step meets all rows and columns.
    const std::size_t step = std::max<std::size_t>(view.points / kPointsPerCloud, 1) | 1U;
    for (std::size_t i = 0; i < view.points; i += step) {
      const auto p = position_of(columns, view.data.data() + i * view.step);
      if (!p) continue;
      const std::uint32_t number = number_of(view, i);
      if (number < 65'536 && (beams.size() < kMaxBeams || beams.contains(number)))
        beams[number].add(elevation_of(*p));
    }
  }
  return beams;
}

/// Median deviation of the elevation within a beam, and median angle between neighbouring beams.
struct Spread {
  double within = 0.0;
  double between = 0.0;
};

std::optional<Spread> spread_of(const ElevationsOfBeams& beams) {
  std::vector<double> means;
  std::vector<double> deviations;
  for (const auto& [number, elevations] : beams) {
    if (elevations.points < 5) continue;
    means.push_back(elevations.mean());
    deviations.push_back(elevations.deviation());
  }
  if (means.size() < 4) return std::nullopt;
  std::sort(means.begin(), means.end());
  std::vector<double> gaps;
  for (std::size_t i = 1; i < means.size(); ++i) gaps.push_back(means[i] - means[i - 1]);
  return Spread{median(std::move(deviations)), median(std::move(gaps))};
}

/// Numbers are beams if the elevations within one differ by less than those of its neighbours, twice over for
/// sensors with staggered lasers.
bool are_beams(const Spread& spread) {
  return spread.between > 0.2 * kSmallestSpacing && spread.within < 2.0 * spread.between;
}

Beams beams_of(const ElevationsOfBeams& elevations, double spacing, BeamSource source) {
  std::vector<std::pair<double, std::uint32_t>> order;
  for (const auto& [number, beam] : elevations) order.emplace_back(beam.mean(), number);
  std::sort(order.begin(), order.end());
  Beams beams;
  beams.source = source;
  beams.count = order.size();
  beams.spacing_rad = static_cast<float>(spacing);
  for (std::size_t rank = 0; rank < order.size(); ++rank) {
    const std::uint32_t number = order[rank].second;
    if (beams.rank_of.size() <= number) beams.rank_of.resize(number + 1);
    beams.rank_of[number] = static_cast<std::uint16_t>(rank);
  }
  return beams;
}

/// Median angle between the elevations of the points within narrow sectors.
double sector_spacing(std::span<const CloudCopy> clouds, const PositionColumns& columns) {
  std::vector<double> gaps;
  for (const CloudCopy& cloud : clouds) {
    const CloudView& view = cloud.view;
    std::map<int, std::vector<double>> sectors;
    for (std::size_t i = 0; i < view.points; ++i) {
      const auto p = position_of(columns, view.data.data() + i * view.step);
      if (!p) continue;
      const double azimuth = portable::atan2(static_cast<double>((*p)[1]), static_cast<double>((*p)[0]));
      const int sector = static_cast<int>(azimuth / kSector);
      if (sector % 10 == 0) sectors[sector].push_back(elevation_of(*p));
    }
    for (auto& [sector, elevations] : sectors) {
      std::sort(elevations.begin(), elevations.end());
      for (std::size_t i = 1; i < elevations.size(); ++i) {
        const double gap = elevations[i] - elevations[i - 1];
        if (gap > kSmallestSpacing) gaps.push_back(gap);
      }
    }
  }
  return gaps.size() < 20 ? kDefaultSpacing : median(std::move(gaps));
}

}  // namespace

std::optional<std::array<float, 3>> position_of(const PositionColumns& columns, const std::uint8_t* point) {
  const std::array<float, 3> p{static_cast<float>(columns.x.at(point)),
                               static_cast<float>(columns.y.at(point)),
                               static_cast<float>(columns.z.at(point))};
  const float square = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
  // Also false for NaN.
  return square > 0.0F && square < 1e12F ? std::optional(p) : std::nullopt;
}

Beams find_beams(std::span<const CloudCopy> clouds, const PositionColumns& columns) {
  const CloudView& first = clouds.front().view;
  if (const CloudField* const field =
          find_field(first, {"ring", "line", "channel", "laser_id", "row", "layer", "line_index", "beam"})) {
    const Column column(*field, first.big_endian);
    const auto number_of = [&](const CloudView& view, std::size_t i) {
      const double number = column.at(view.data.data() + i * view.step);
      return number >= 0.0 && number < 65'536.0 ? static_cast<std::uint32_t>(number) : std::uint32_t{65'536};
    };
    const ElevationsOfBeams elevations = collect(clouds, columns, number_of);
    if (const auto spread = spread_of(elevations); spread && are_beams(*spread)) {
      Beams beams = beams_of(elevations, spread->between, BeamSource::kField);
      beams.field = field->name;
      return beams;
    }
  }
  if (first.height > 1 && first.width > 1) {
    const auto row = [](const CloudView& view, std::size_t i) {
      return static_cast<std::uint32_t>(i / view.width);
    };
    const auto column = [](const CloudView& view, std::size_t i) {
      return static_cast<std::uint32_t>(i % view.width);
    };
    for (const BeamSource source : {BeamSource::kRow, BeamSource::kColumn}) {
      const ElevationsOfBeams elevations =
          source == BeamSource::kRow ? collect(clouds, columns, row) : collect(clouds, columns, column);
      const std::size_t size = source == BeamSource::kRow ? first.height : first.width;
      const auto spread = spread_of(elevations);
      if (size <= kMaxBeams && spread && are_beams(*spread))
        return beams_of(elevations, spread->between, source);
    }
  }
  Beams beams;
  beams.spacing_rad = static_cast<float>(sector_spacing(clouds, columns));
  return beams;
}

}  // namespace nilio::drivers::bag
