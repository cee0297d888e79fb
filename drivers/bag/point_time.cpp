#include "drivers/bag/point_time.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <vector>

namespace nilio::drivers::bag {

namespace {

using core::Error;
using Origin = PointTimeForm::Origin;

// Sweeps of LiDARs: 5 to 50 Hz, a part of the circle or all of it.
constexpr double kShortestSweep = 0.020;
constexpr double kLongestSweep = 0.300;
// Tolerance of these limits, for the gap between the last point of a sweep and the first of the next.
constexpr double kTolerance = 0.05;
constexpr double kSmallestShare = 0.3;
constexpr double kLargestShare = 1.15;
// An f32 resolves 2^-24 of its value.
constexpr double kFloatLimit = 1e4;

struct Unit {
  double seconds;
  const char* name;
};
constexpr std::array<Unit, 4> kUnits{{{1.0, "s"}, {1e-3, "ms"}, {1e-6, "us"}, {1e-9, "ns"}}};

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double median_of(std::span<const RawTimes> clouds, const std::function<double(const RawTimes&)>& value) {
  std::vector<double> values;
  for (const RawTimes& cloud : clouds) values.push_back(value(cloud));
  return median(std::move(values));
}

bool is_sweep(double seconds, std::optional<double> period) {
  const bool fits_period =
      !period || (seconds >= kSmallestShare * *period && seconds <= kLargestShare * *period);
  return seconds >= kShortestSweep * (1.0 - kTolerance) && seconds <= kLongestSweep && fits_period;
}

template <class... Values>
std::string text(const char* format, Values... values) {
  std::array<char, 320> line{};
  std::snprintf(line.data(), line.size(), format, values...);
  return line.data();
}

/// Origin and its description for a unit.
PointTimeForm with_origin(PointTimeForm form, std::span<const RawTimes> clouds,
                          std::optional<double> period) {
  const double u = form.unit_s;
  const double span = median_of(clouds, [&](const RawTimes& c) { return (c.max - c.min) * u; });
  const double first = median_of(clouds, [&](const RawTimes& c) { return c.min * u; });
  const double last = median_of(clouds, [&](const RawTimes& c) { return c.max * u; });
  const double after_header = median_of(clouds, [&](const RawTimes& c) { return c.min * u - c.header_s; });
  const double received = median_of(clouds, [](const RawTimes& c) { return c.received_s; });
  const double sweep = period.value_or(span);
  const double header = clouds.front().header_s;
  if (std::abs(after_header) < 1.0 && std::abs(header) > 1.0) {
    form.origin = Origin::kAbsolute;
    form.text += " of the header's clock (absolute)";
  } else if (std::abs(first) < 0.5 && std::abs(last) < 0.5) {
    form.origin = Origin::kHeader;
    if (first >= -0.01 * sweep) {
      form.text += " from the header's stamp, the start of the sweep";
      // A cloud arrives after its last point. Equal times are a converted recording, which tells nothing.
      if (received > 1e-6 && received < 0.5 * last) {
        form.origin = Origin::kLast;
        form.text += text("; clouds were received %.0f ms after it: it is taken as the end", received * 1e3);
        form.warning = text(
            "the header's stamp is taken as the end of the sweep, because clouds were received %.0f ms after "
            "it and "
            "the points span %.0f ms - set point_times to start if it is the start",
            received * 1e3, span * 1e3);
      }
    } else if (last <= 0.02 * sweep + 0.002) {
      form.text += " from the header's stamp, the end of the sweep";
    } else {
      form.text += " from the header's stamp, within the sweep";
    }
  } else {
    form.origin = Origin::kFirst;
    form.text += " of another clock; the first point is set to the header's stamp";
    form.warning = text(
        "the clock of the points is %.3f s from that of the headers; the first point of each "
        "sweep is taken at the header's stamp",
        after_header);
  }
  return form;
}

PointTimeForm with_wanted_origin(PointTimeForm form, PointTimes wanted) {
  form.origin = wanted == PointTimes::kStart ? Origin::kFirst
                : wanted == PointTimes::kEnd ? Origin::kLast
                                             : Origin::kMiddle;
  const char* const place = wanted == PointTimes::kStart ? "first point"
                            : wanted == PointTimes::kEnd ? "last point"
                                                         : "middle";
  form.text += std::string(", the ") + place + " at the header's stamp (point_times)";
  return form;
}

/// Successive sweeps must follow each other: an origin that is wrong makes them overlap.
std::string overlap_warning(const PointTimeForm& form, std::span<const RawTimes> clouds) {
  if (form.origin != Origin::kAbsolute && form.origin != Origin::kHeader) return {};
  std::vector<double> gaps;
  for (std::size_t i = 1; i < clouds.size(); ++i) {
    const double base = form.origin == Origin::kHeader ? clouds[i].header_s - clouds[i - 1].header_s : 0.0;
    gaps.push_back(base + (clouds[i].min - clouds[i - 1].max) * form.unit_s);
  }
  if (gaps.empty()) return {};
  const double span = median_of(clouds, [&](const RawTimes& c) { return (c.max - c.min) * form.unit_s; });
  const double gap = median(std::move(gaps));
  if (gap > -0.1 * span) return {};
  return text("successive sweeps overlap by %.0f ms of %.0f ms: their times are doubtful", -gap * 1e3,
              span * 1e3);
}

}  // namespace

std::optional<double> sweep_period(std::span<const RawTimes> clouds) {
  std::vector<double> periods;
  for (std::size_t i = 1; i < clouds.size(); ++i)
    periods.push_back(clouds[i].header_s - clouds[i - 1].header_s);
  if (periods.empty()) return std::nullopt;
  const double period = median(std::move(periods));
  return period >= kShortestSweep * (1.0 - kTolerance) && period <= kLongestSweep * (1.0 + kTolerance)
             ? std::optional(period)
             : std::nullopt;
}

core::Result<std::optional<PointTimeForm>> recognise_point_times(std::span<const RawTimes> clouds,
                                                                 bool is_float, PointTimes wanted) {
  if (clouds.empty()) return std::optional<PointTimeForm>{};
  const double span = median_of(clouds, [](const RawTimes& c) { return c.max - c.min; });
  const double least = median_of(clouds, [](const RawTimes& c) { return c.min; });
  const std::optional<double> period = sweep_period(clouds);
  if (is_float && std::abs(least) > kFloatLimit * std::max(span, 1e-9) && std::abs(least) > kFloatLimit)
    return Error{
        text("its times are 32-bit floats near %.6g, which cannot hold a sweep (span %.3g) - set "
             "point_times to azimuth, or record the field as float64",
             least, span)};
  if (span == 0.0) return std::optional<PointTimeForm>{};
  PointTimeForm form;
  const auto fits = [&](const Unit& unit) { return is_sweep(span * unit.seconds, period); };
  const auto* const unit = std::ranges::find_if(kUnits, fits);
  const bool is_index = std::ranges::all_of(clouds, [](const RawTimes& c) { return c.is_index; });
  if (unit != kUnits.end() && !is_index) {
    form.unit_s = unit->seconds;
    form.text = unit->name;
  } else if (std::abs(least) < 1e-6 && std::abs(span - 1.0) < 0.05 && period) {
    form.unit_s = *period;
    form.text = text("shares of a sweep of %.1f ms", *period * 1e3);
  } else {
    return Error{
        text("its times cannot be recognised: %s (from %.9g to %.9g, %s between clouds), in no unit (s, ms, "
             "us, ns) a sweep of 20 to 300 ms - set point_times to azimuth or none, or correct the "
             "field",
             is_index ? "they are the numbers of the points" : "a cloud spans too much or too little", least,
             least + span, period ? text("%.1f ms", *period * 1e3).c_str() : "an unknown time")};
  }
  const bool is_forced =
      wanted == PointTimes::kStart || wanted == PointTimes::kEnd || wanted == PointTimes::kMiddle;
  form =
      is_forced ? with_wanted_origin(std::move(form), wanted) : with_origin(std::move(form), clouds, period);
  if (form.warning.empty()) form.warning = overlap_warning(form, clouds);
  return std::optional(form);
}

}  // namespace nilio::drivers::bag
