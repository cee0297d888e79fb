#include "nilio/drivers/bag/point_cloud.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "drivers/bag/beams.hpp"
#include "drivers/bag/columns.hpp"
#include "drivers/bag/point_time.hpp"

#include <algorithm>
#include <array>
#include <bitset>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <utility>

namespace nilio::drivers {

namespace {

using bag::Beams;
using bag::BeamSource;
using bag::Column;
using bag::PointTimeForm;
using core::Error;
using core::Result;
using Origin = PointTimeForm::Origin;

constexpr std::array<const char*, 6> kTimesNames{"auto", "start", "end", "middle", "azimuth", "none"};
// Points of a cloud whose times are sampled for its span, and the share of stray ones on either side.
constexpr std::size_t kTimeSamples = 4096;
constexpr double kStrayShare = 0.001;
constexpr double kWrap = 4294967296.0;
constexpr double kTwoPi = 2.0 * std::numbers::pi;
// Turn of the azimuth over a cloud in firing order.
constexpr double kShortestTurn = 300.0 / 360.0 * kTwoPi;
constexpr double kLongestTurn = 400.0 / 360.0 * kTwoPi;
constexpr std::size_t kCoverageStep = 7;
// Longest sweep of a recognised topic that is decoded, twice that of recognition: a turn may have been
// missed.
constexpr double kLongestSweep = 2.0 * 0.3;
// Clocks of header and points were recognised within 1 s of each other; times that left it are damaged.
constexpr double kFarthestFromHeader = 10.0;
// Range of the stamps of messages, 32 bits of seconds.
constexpr double kLatestSecond = 4294967296.0;

template <class... Values>
std::string text(const char* format, Values... values) {
  std::array<char, 320> line{};
  std::snprintf(line.data(), line.size(), format, values...);
  return line.data();
}

double wrapped(double angle) { return angle - kTwoPi * std::round(angle / kTwoPi); }

double azimuth_of(const std::array<float, 3>& p) {
  return portable::atan2(static_cast<double>(p[1]), static_cast<double>(p[0]));
}

/// Times by azimuth: of clouds in firing order by the turn since the first point; otherwise of a clockwise
/// sweep cut behind the vehicle.
struct AzimuthTimes {
  bool is_in_firing_order = false;
  double direction = -1.0;
  double period_s = 0.0;
};

/// Columns and rules of a topic.
struct Layout {
  bag::PositionColumns position;
  std::optional<Column> time;
  std::optional<Column> intensity;
  double intensity_factor = 1.0;
  std::optional<PointTimeForm> form;
  std::optional<AzimuthTimes> azimuth;
  PointTimes wanted = PointTimes::kAuto;
  Beams beams;
  std::optional<Column> beam;
};

/// Smallest and largest time of a cloud without stray points, and whether 32-bit ticks wrap within it.
struct TimeSpan {
  double min = 0.0;
  double max = 0.0;
  bool wraps = false;
};

double unwrapped(double raw, bool wraps) { return wraps && raw < 0.5 * kWrap ? raw + kWrap : raw; }

std::optional<TimeSpan> time_span(const CloudView& cloud, const Layout& layout, std::vector<double>& values) {
  values.clear();
  const std::size_t step = std::max<std::size_t>(cloud.points / kTimeSamples, 1) | 1U;
  for (std::size_t i = 0; i < cloud.points; i += step) {
    const std::uint8_t* const point = cloud.data.data() + i * cloud.step;
    const double raw = layout.time->at(point);
    if (std::isfinite(raw) && bag::position_of(layout.position, point)) values.push_back(raw);
  }
  if (values.empty()) return std::nullopt;
  TimeSpan span;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  span.wraps = layout.time->type() == 6 && *high - *low > 0.5 * kWrap;
  for (double& value : values) value = unwrapped(value, span.wraps);
  const auto strays = static_cast<std::size_t>(kStrayShare * static_cast<double>(values.size()));
  const auto at = [&](std::size_t index) {
    const auto place = values.begin() + static_cast<std::ptrdiff_t>(index);
    std::nth_element(values.begin(), place, values.end());
    return *place;
  };
  span.min = at(strays);
  span.max = at(values.size() - 1 - strays);
  return span;
}

/// Whether the field counts the points.
bool is_index(const CloudView& cloud, const Column& time) {
  const std::size_t step = std::max<std::size_t>(cloud.points / 64, 1);
  for (std::size_t i = 0; i < cloud.points; i += step) {
    if (time.at(cloud.data.data() + i * cloud.step) != static_cast<double>(i)) return false;
  }
  return cloud.points > 1;
}

std::vector<bag::RawTimes> raw_times(std::span<const CloudCopy> clouds, const Layout& layout) {
  std::vector<bag::RawTimes> times;
  std::vector<double> values;
  for (const CloudCopy& cloud : clouds) {
    const CloudView& view = cloud.view;
    bag::RawTimes raw;
    raw.header_s = view.header.stamp.seconds();
    raw.received_s = (view.received - view.header.stamp).seconds();
    if (layout.time) {
      const auto span = time_span(view, layout, values);
      if (!span) continue;
      raw.min = span->min;
      raw.max = span->max;
      raw.is_index = is_index(view, *layout.time);
    }
    times.push_back(raw);
  }
  return times;
}

AzimuthTimes find_azimuth_times(const CloudView& cloud, const bag::PositionColumns& position,
                                double period_s) {
  AzimuthTimes result;
  result.period_s = period_s;
  std::optional<double> last;
  double turn = 0.0;
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const auto p = bag::position_of(position, cloud.data.data() + i * cloud.step);
    if (!p) continue;
    const double azimuth = azimuth_of(*p);
    if (last) turn += wrapped(azimuth - *last);
    last = azimuth;
  }
  result.is_in_firing_order = std::abs(turn) > kShortestTurn && std::abs(turn) < kLongestTurn;
  if (result.is_in_firing_order) result.direction = turn > 0.0 ? 1.0 : -1.0;
  return result;
}

/// Degrees of the circle with points.
double covered_deg(const CloudView& cloud, const bag::PositionColumns& position) {
  std::bitset<360> covered;
  for (std::size_t i = 0; i < cloud.points; i += kCoverageStep) {
    const auto p = bag::position_of(position, cloud.data.data() + i * cloud.step);
    if (!p) continue;
    const auto degree = static_cast<std::size_t>((azimuth_of(*p) + std::numbers::pi) / kTwoPi * 360.0);
    covered.set(std::min<std::size_t>(degree, 359));
  }
  return static_cast<double>(covered.count());
}

}  // namespace

std::span<const char* const> point_times_names() { return kTimesNames; }

std::optional<PointTimes> parse_point_times(std::string_view name) {
  for (std::size_t i = 0; i < kTimesNames.size(); ++i) {
    if (name == kTimesNames[i]) return static_cast<PointTimes>(i);
  }
  return std::nullopt;
}

CloudCopy::CloudCopy(const CloudView& cloud) : view(cloud), bytes(cloud.data.begin(), cloud.data.end()) {
  view.data = bytes;
}

struct CloudDecoder::Impl {
  std::string name;
  Layout layout;
  std::vector<CloudField> fields;
  std::vector<std::string> notes;
  std::vector<std::string> warnings;
  std::vector<double> values;
  std::uint64_t stray_points = 0;
  std::uint32_t step = 0;
  bool big_endian = false;

  Result<std::monostate> analyse(std::span<const CloudCopy> clouds, PointTimes wanted);
  void map_columns(const CloudView& cloud);
  Result<std::monostate> find_times(std::span<const CloudCopy> clouds, PointTimes wanted);
  void find_intensity_factor(std::span<const CloudCopy> clouds);
  void describe(const CloudView& cloud, std::string times);
  [[nodiscard]] bool has_same_layout(const CloudView& cloud) const;
  bool add_with_times(const CloudView& cloud, core::Scan& scan);
  void add_by_azimuth(const CloudView& cloud, core::Scan& scan) const;
  [[nodiscard]] core::Point make_point(const CloudView& cloud, std::size_t index,
                                       const std::array<float, 3>& position) const;
};

void CloudDecoder::Impl::map_columns(const CloudView& cloud) {
  const auto column = [&](std::initializer_list<std::string_view> names) -> std::optional<Column> {
    const CloudField* const field = bag::find_field(cloud, names);
    return field == nullptr ? std::nullopt : std::optional(Column(*field, cloud.big_endian));
  };
  fields = cloud.fields;
  step = cloud.step;
  big_endian = cloud.big_endian;
  const auto x = column({"x"});
  const auto y = column({"y"});
  const auto z = column({"z"});
  if (x && y && z) layout.position = {*x, *y, *z};
  layout.time = column({"t", "time", "timestamp", "time_stamp", "offset_time", "time_offset", "timeOffset",
                        "time_offset_ns", "stamp", "stamps", "ts"});
  // The calibrated reflectivity where there is one.
  layout.intensity = column({"reflectivity", "intensity", "i", "reflectance"});
  layout.beam = layout.beams.field.empty() ? std::nullopt : column({layout.beams.field});
}

Result<std::monostate> CloudDecoder::Impl::find_times(std::span<const CloudCopy> clouds, PointTimes wanted) {
  layout.wanted = wanted;
  const std::vector<bag::RawTimes> raw = raw_times(clouds, layout);
  const bool uses_field = layout.time && wanted != PointTimes::kAzimuth && wanted != PointTimes::kNone;
  std::string times;
  if (uses_field) {
    auto form = bag::recognise_point_times(raw, layout.time->type() == 7, wanted);
    if (!form) return Error{name + ": " + form.error().message};
    layout.form = *form;
    if (layout.form) {
      times = "times in " + layout.form->text;
      if (!layout.form->warning.empty()) warnings.push_back(name + ": " + layout.form->warning);
    }
  }
  const std::optional<double> period = bag::sweep_period(raw);
  const CloudView& view = clouds.front().view;
  const bool is_round = covered_deg(view, layout.position) >= 300.0;
  if (!layout.form && wanted == PointTimes::kAzimuth && (!period || !is_round))
    return Error{name +
                 (period ? ": its points surround less than 300 degrees"
                         : ": the time between its clouds is none "
                           "of sweeps (20 to 300 ms)") +
                 ", so that azimuth gives no times - set point_times to none"};
  if (!layout.form && wanted != PointTimes::kNone && period && is_round) {
    layout.azimuth = find_azimuth_times(view, layout.position, *period);
    times = text("no times of points: they follow from azimuth at %.1f ms a turn, %s", *period * 1e3,
                 layout.azimuth->is_in_firing_order
                     ? "in the order of the points"
                     : "clockwise from behind the vehicle, the header's stamp in front");
    if (wanted != PointTimes::kAzimuth) warnings.push_back(name + ": " + times);
  } else if (!layout.form) {
    times = "no times of points: each cloud counts as taken at its stamp";
    if (wanted != PointTimes::kNone) warnings.push_back(name + ": " + times + ", and is not deskewed");
  }
  describe(view, std::move(times));
  return std::monostate{};
}

void CloudDecoder::Impl::find_intensity_factor(std::span<const CloudCopy> clouds) {
  if (!layout.intensity || layout.intensity->type() < 7) return;
  double largest = 0.0;
  for (const CloudCopy& cloud : clouds) {
    for (std::size_t i = 0; i < cloud.view.points; i += 11) {
      const double value = layout.intensity->at(cloud.view.data.data() + i * cloud.view.step);
      if (std::isfinite(value)) largest = std::max(largest, value);
    }
  }
  if (largest > 0.0 && largest <= 1.0) layout.intensity_factor = 255.0;
}

void CloudDecoder::Impl::describe(const CloudView& cloud, std::string times) {
  const Beams& beams = layout.beams;
  const double spacing_deg = static_cast<double>(beams.spacing_rad) * 180.0 / std::numbers::pi;
  const std::string shape =
      cloud.height > 1 ? text("%u x %u points", cloud.height, cloud.width) : text("%zu points", cloud.points);
  const std::string from = beams.source == BeamSource::kField    ? "field '" + beams.field + "'"
                           : beams.source == BeamSource::kRow    ? "its rows"
                           : beams.source == BeamSource::kColumn ? "its columns"
                                                                 : "";
  const std::string numbered =
      from.empty() ? "no beams of constant elevation" : text("%zu beams from ", beams.count) + from;
  notes.push_back(name + ": " + shape + " in the first cloud, " + times + "; " + numbered +
                  text(", spacing %.2f deg", spacing_deg));
}

Result<std::monostate> CloudDecoder::Impl::analyse(std::span<const CloudCopy> clouds, PointTimes wanted) {
  const CloudView& first = clouds.front().view;
  if (bag::find_field(first, {"x"}) == nullptr || bag::find_field(first, {"y"}) == nullptr ||
      bag::find_field(first, {"z"}) == nullptr)
    return Error{name + ": its points have no fields x, y and z - choose another topic"};
  map_columns(first);
  // Columns hold for clouds of one layout only.
  const auto other =
      std::ranges::find_if(clouds, [&](const CloudCopy& cloud) { return !has_same_layout(cloud.view); });
  clouds = clouds.first(static_cast<std::size_t>(other - clouds.begin()));
  layout.beams = bag::find_beams(clouds, layout.position);
  map_columns(first);
  find_intensity_factor(clouds);
  return find_times(clouds, wanted);
}

bool CloudDecoder::Impl::has_same_layout(const CloudView& cloud) const {
  return cloud.step == step && cloud.big_endian == big_endian &&
         std::ranges::equal(cloud.fields, fields, [](const CloudField& a, const CloudField& b) {
           return a.offset == b.offset && a.type == b.type && a.name == b.name;
         });
}

core::Point CloudDecoder::Impl::make_point(const CloudView& cloud, std::size_t index,
                                           const std::array<float, 3>& position) const {
  core::Point point;
  point.x = position[0];
  point.y = position[1];
  point.z = position[2];
  const std::uint8_t* const from = cloud.data.data() + index * cloud.step;
  if (layout.intensity) {
    const double intensity = layout.intensity->at(from) * layout.intensity_factor;
    point.intensity = static_cast<float>(intensity > 0.0 ? std::min(intensity, 255.0) : 0.0);
  }
  double number = -1.0;
  if (layout.beams.source == BeamSource::kField && layout.beam) number = layout.beam->at(from);
  if (layout.beams.source == BeamSource::kRow) number = static_cast<double>(index / cloud.width);
  if (layout.beams.source == BeamSource::kColumn) number = static_cast<double>(index % cloud.width);
  if (number >= 0.0 && number < static_cast<double>(layout.beams.rank_of.size()))
    point.ring = layout.beams.rank_of[static_cast<std::size_t>(number)];
  return point;
}

/// Points with the times of their field. The offset of a point is first stated from the span's begin.
bool CloudDecoder::Impl::add_with_times(const CloudView& cloud, core::Scan& scan) {
  const auto span = time_span(cloud, layout, values);
  if (!span) return false;
  const PointTimeForm& form = *layout.form;
  const double length_s = (span->max - span->min) * form.unit_s;
  if (length_s > kLongestSweep) return false;
  const core::Time header = cloud.header.stamp;
  core::Time base = header;
  switch (form.origin) {
    case Origin::kHeader:
      if (std::abs(span->min * form.unit_s) > kFarthestFromHeader) return false;
      base = header + core::Duration::from_seconds(span->min * form.unit_s);
      break;
    case Origin::kLast:
      base = header - core::Duration::from_seconds(length_s);
      break;
    case Origin::kMiddle:
      base = header - core::Duration::from_seconds(0.5 * length_s);
      break;
    case Origin::kFirst:
      break;
    case Origin::kAbsolute: {
      // Whole seconds apart from the fraction: their product with 1e9 is beyond the precision of a double.
      const double seconds = std::floor(span->min * form.unit_s);
      if (seconds < 0.0 || seconds >= kLatestSecond) return false;
      const double fraction = (span->min - seconds / form.unit_s) * form.unit_s;
      base = core::Time{static_cast<std::int64_t>(seconds) * kNanosecondsPerSecond} +
             core::Duration::from_seconds(fraction);
      break;
    }
  }
  const double margin_s = 0.1 * length_s;
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const std::uint8_t* const from = cloud.data.data() + i * cloud.step;
    const auto position = bag::position_of(layout.position, from);
    if (!position) continue;
    const double offset_s = (unwrapped(layout.time->at(from), span->wraps) - span->min) * form.unit_s;
    // Also false for NaN.
    if (!(offset_s >= -margin_s && offset_s <= length_s + margin_s)) {
      ++stray_points;
      continue;
    }
    core::Point point = make_point(cloud, i, *position);
    point.time_offset_ns = static_cast<std::int32_t>(std::lround(offset_s * 1e9));
    scan.points.push_back(point);
  }
  scan.start = base;
  return true;
}

void CloudDecoder::Impl::add_by_azimuth(const CloudView& cloud, core::Scan& scan) const {
  const AzimuthTimes* const azimuth = layout.azimuth ? &*layout.azimuth : nullptr;
  std::optional<double> last;
  double turn = 0.0;
  double largest = 0.0;
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const auto position = bag::position_of(layout.position, cloud.data.data() + i * cloud.step);
    if (!position) continue;
    core::Point point = make_point(cloud, i, *position);
    if (azimuth != nullptr) {
      const double angle = azimuth_of(*position);
      double share = 0.5 - 0.5 * angle / std::numbers::pi;
      if (azimuth->is_in_firing_order) {
        if (last) turn += azimuth->direction * wrapped(angle - *last);
        last = angle;
        share = turn / kTwoPi;
      }
      largest = std::max(largest, share);
      point.time_offset_ns =
          static_cast<std::int32_t>(std::lround(std::clamp(share, -0.1, 1.2) * azimuth->period_s * 1e9));
    }
    scan.points.push_back(point);
  }
  scan.start = cloud.header.stamp;
  if (azimuth == nullptr) return;
  // The header's stamp is that of the front, of the last point, or of the first one.
  double share_at_header = azimuth->is_in_firing_order ? 0.0 : 0.5;
  if (layout.wanted == PointTimes::kEnd) share_at_header = largest;
  if (layout.wanted == PointTimes::kStart) share_at_header = 0.0;
  if (layout.wanted == PointTimes::kMiddle) share_at_header = 0.5 * largest;
  scan.start = cloud.header.stamp - core::Duration::from_seconds(share_at_header * azimuth->period_s);
}

CloudDecoder::CloudDecoder(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
CloudDecoder::CloudDecoder(CloudDecoder&&) noexcept = default;
CloudDecoder& CloudDecoder::operator=(CloudDecoder&&) noexcept = default;
CloudDecoder::~CloudDecoder() = default;

Result<CloudDecoder> CloudDecoder::create(std::span<const CloudCopy> clouds, const std::string& name,
                                          PointTimes times) {
  const auto has_points = [](const CloudCopy& cloud) { return cloud.view.points > 0; };
  if (!std::ranges::any_of(clouds, has_points)) return Error{name + ": its clouds have no points"};
  auto impl = std::make_unique<Impl>();
  impl->name = name;
  // A first cloud may be empty.
  const auto first = std::ranges::find_if(clouds, has_points);
  if (auto analysed = impl->analyse({first, clouds.end()}, times); !analysed) return analysed.error();
  return CloudDecoder(std::move(impl));
}

bool CloudDecoder::decode(const CloudView& cloud, core::Scan& scan) {
  scan.points.clear();
  if (!impl_->has_same_layout(cloud)) {
    if (bag::find_field(cloud, {"x"}) == nullptr || bag::find_field(cloud, {"y"}) == nullptr ||
        bag::find_field(cloud, {"z"}) == nullptr)
      return false;
    impl_->map_columns(cloud);
  }
  if (cloud.points == 0 || (impl_->layout.form && !impl_->layout.time)) return false;
  if (!impl_->layout.form) {
    impl_->add_by_azimuth(cloud, scan);
  } else if (!impl_->add_with_times(cloud, scan)) {
    return false;
  }
  if (scan.points.empty()) return false;
  const auto [first, last] = std::ranges::minmax(scan.points, {}, &core::Point::time_offset_ns);
  const std::int32_t first_ns = first.time_offset_ns;
  scan.end = scan.start + core::Duration{last.time_offset_ns};
  scan.start = scan.start + core::Duration{first_ns};
  for (core::Point& point : scan.points) point.time_offset_ns -= first_ns;
  scan.motion_compensated = !impl_->layout.form && !impl_->layout.azimuth;
  scan.beam_spacing_rad = impl_->layout.beams.spacing_rad;
  scan.coverage_deg = static_cast<float>(covered_deg(cloud, impl_->layout.position));
  scan.lost_packets = 0;
  scan.missing_firings = 0;
  scan.clock_source = core::ClockSource::kHost;
  scan.after_time_jump = false;
  return true;
}

const std::vector<std::string>& CloudDecoder::notes() const { return impl_->notes; }
const std::vector<std::string>& CloudDecoder::warnings() const { return impl_->warnings; }
std::uint64_t CloudDecoder::stray_points() const { return impl_->stray_points; }

}  // namespace nilio::drivers
