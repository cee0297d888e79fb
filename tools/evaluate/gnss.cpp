#include "tools/evaluate/gnss.hpp"

#include "tools/common/text.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::evaluate {

namespace {

using gnss::Match;

/// `values` hold one or more.
PositionErrors errors_of(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  PositionErrors errors;
  for (const double value : values) errors.rmse += value * value / static_cast<double>(values.size());
  errors.rmse = std::sqrt(errors.rmse);
  const auto quantile = [&](double share) {
    return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
  };
  errors.median = quantile(0.5);
  errors.p95 = quantile(0.95);
  errors.maximum = values.back();
  return errors;
}

DisplacementError displacements_over(double length_m, const std::vector<Match>& matches,
                                     const std::vector<double>& path_m) {
  // Mean length of a normal vector in the plane, in its standard deviations.
  const double mean_length = std::sqrt(std::numbers::pi / 2.0);
  DisplacementError error;
  error.length_m = length_m;
  double sum = 0.0;
  double stated = 0.0;
  bool is_stated = true;
  std::size_t j = 0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    while (j < matches.size() && path_m[j] - path_m[i] < length_m) ++j;
    if (j == matches.size()) break;
    const Match& from = matches[i];
    const Match& to = matches[j];
    sum += ((to.track - from.track) - (to.estimate - from.estimate)).head<2>().norm() / length_m;
    is_stated &= from.deviation_m && to.deviation_m;
    if (is_stated) stated += mean_length * std::hypot(*from.deviation_m, *to.deviation_m) / length_m;
    ++error.count;
  }
  if (error.count == 0) return error;
  const auto count = static_cast<double>(error.count);
  error.percent = 100.0 * sum / count;
  if (is_stated) error.stated_percent = 100.0 * stated / count;
  return error;
}

/// Root of the mean square; empty if one is not stated.
template <class Square>
std::optional<double> root_mean(const std::vector<Match>& matches, Square square_of) {
  double sum = 0.0;
  for (const Match& match : matches) {
    const std::optional<double> square = square_of(match);
    if (!square) return std::nullopt;
    sum += *square / static_cast<double>(matches.size());
  }
  return std::sqrt(sum);
}

void append_errors(std::string& text, const char* name, const PositionErrors& errors,
                   std::optional<double> stated_m) {
  text += format("  %-12s %10.3f %10.3f %10.3f %10.3f  m", name, errors.rmse, errors.median, errors.p95,
                 errors.maximum);
  if (stated_m) text += format("   stated by the receiver: rmse %.3f m", *stated_m);
  text += '\n';
}

nlohmann::json optional_json(std::optional<double> value) {
  return value ? nlohmann::json(*value) : nlohmann::json();
}

nlohmann::json errors_json(const PositionErrors& errors, std::optional<double> stated_m) {
  return {{"rmse_m", errors.rmse},
          {"median_m", errors.median},
          {"p95_m", errors.p95},
          {"max_m", errors.maximum},
          {"stated_rmse_m", optional_json(stated_m)}};
}

nlohmann::json displacement_json(const DisplacementError& error) {
  return {{"translation_percent", error.percent},
          {"stated_percent", optional_json(error.stated_percent)},
          {"segments", error.count}};
}

}  // namespace

GnssEvaluation evaluate_gnss(const gnss::Georeference& georeference, const gnss::Track& track,
                             std::vector<double> lengths_m) {
  const std::vector<Match>& matches = georeference.matches;
  GnssEvaluation result;
  result.positions = matches.size();
  result.unmatched = track.fixes.size() - matches.size();
  std::vector<double> path_m;
  std::vector<double> horizontal;
  std::vector<double> vertical;
  for (const Match& match : matches) {
    if (!path_m.empty()) result.path_m += (match.estimate - matches[path_m.size() - 1].estimate).norm();
    path_m.push_back(result.path_m);
    horizontal.push_back((match.track - match.estimate).head<2>().norm());
    if (match.has_altitude) vertical.push_back(std::abs(match.track.z() - match.estimate.z()));
  }
  result.horizontal = errors_of(std::move(horizontal));
  if (!vertical.empty()) result.vertical = errors_of(std::move(vertical));
  result.stated_horizontal_rmse_m = root_mean(matches, [](const Match& match) {
    return match.deviation_m ? std::optional(2.0 * *match.deviation_m * *match.deviation_m) : std::nullopt;
  });
  result.stated_vertical_rmse_m = root_mean(matches, [](const Match& match) {
    return match.up_deviation_m ? std::optional(*match.up_deviation_m * *match.up_deviation_m) : std::nullopt;
  });
  if (lengths_m.empty()) {
    const double unit_m = result.path_m >= 100.0 ? 100.0 : 10.0;
    for (int i = 1; i <= 8; ++i) lengths_m.push_back(unit_m * i);
  }
  DisplacementError all;
  double stated = 0.0;
  bool is_stated = true;
  for (const double length_m : lengths_m) {
    const DisplacementError error = displacements_over(length_m, matches, path_m);
    if (error.count == 0) continue;
    const auto count = static_cast<double>(error.count);
    all.count += error.count;
    all.percent += count * error.percent;
    is_stated &= error.stated_percent.has_value();
    stated += count * error.stated_percent.value_or(0.0);
    result.per_length.push_back(error);
  }
  if (all.count > 0) {
    all.percent /= static_cast<double>(all.count);
    if (is_stated) all.stated_percent = stated / static_cast<double>(all.count);
    result.all = all;
  }
  return result;
}

std::string gnss_report(const GnssEvaluation& evaluation, const gnss::Georeference& georeference,
                        const gnss::Track& track) {
  std::string text = "truth       GNSS " + track.name + ": " + gnss::summary(track) + "\n";
  for (const std::string& note : track.notes) text += "            " + note + "\n";
  const gnss::GeodeticOrigin& origin = georeference.origin;
  text += format(
      "positions   %zu associated, %zu without a pose; path of the estimate %.1f m, size of the track / "
      "estimate %.5f\n",
      evaluation.positions, evaluation.unmatched, evaluation.path_m, georeference.scale);
  text += format("frame       at %.8f, %.8f, %.2f m; x axis %.3f deg clockwise from north (fitted)\n",
                 origin.latitude_deg, origin.longitude_deg, origin.altitude_m, origin.heading_deg);
  if (georeference.better_offset)
    text += format(
        "time        %+.3f s added to the times of the track halve the squared error or better: "
        "--time-offset\n",
        georeference.better_offset->seconds());
  text += format("\n  %-12s %10s %10s %10s %10s\n", "error", "rmse", "median", "95 %", "max");
  append_errors(text, "horizontal", evaluation.horizontal, evaluation.stated_horizontal_rmse_m);
  if (evaluation.vertical)
    append_errors(text, "vertical", *evaluation.vertical, evaluation.stated_vertical_rmse_m);
  text +=
      "\nDisplacements, horizontal (error in percent of the path; part of the stated deviations of the "
      "positions)\n";
  if (!evaluation.all) return text + "  none: the path is shorter than the shortest segment\n";
  const auto row = [&](const std::string& name, const DisplacementError& error) {
    text += format("  %-10s %12.4f %12s %10zu\n", name.c_str(), error.percent,
                   error.stated_percent ? format("%.4f", *error.stated_percent).c_str() : "-", error.count);
  };
  text += format("  %-10s %12s %12s %10s\n", "length", "t_rel %", "stated %", "segments");
  for (const DisplacementError& error : evaluation.per_length) row(format("%g m", error.length_m), error);
  row("mean", *evaluation.all);
  return text;
}

std::string gnss_json(const GnssEvaluation& evaluation, const gnss::Georeference& georeference,
                      const gnss::Track& track) {
  const gnss::GeodeticOrigin& origin = georeference.origin;
  nlohmann::json json = {
      {"truth", {{"gnss", track.name}, {"notes", track.notes}, {"without_fix", track.without_fix}}},
      {"positions", {{"associated", evaluation.positions}, {"unmatched_truth", evaluation.unmatched}}},
      {"path", {{"estimate_m", evaluation.path_m}, {"ratio", 1.0 / georeference.scale}}},
      {"frame",
       {{"latitude_deg", origin.latitude_deg},
        {"longitude_deg", origin.longitude_deg},
        {"altitude_m", origin.altitude_m},
        {"heading_deg", origin.heading_deg}}},
      {"better_time_offset_s",
       georeference.better_offset ? nlohmann::json(georeference.better_offset->seconds()) : nlohmann::json()},
      {"horizontal", errors_json(evaluation.horizontal, evaluation.stated_horizontal_rmse_m)},
      {"vertical", evaluation.vertical ? errors_json(*evaluation.vertical, evaluation.stated_vertical_rmse_m)
                                       : nlohmann::json()},
      {"segments", nullptr}};
  if (evaluation.all) {
    json["segments"] = displacement_json(*evaluation.all);
    json["segments"]["per_length"] = nlohmann::json::array();
    for (const DisplacementError& error : evaluation.per_length) {
      nlohmann::json row = displacement_json(error);
      row["length_m"] = error.length_m;
      json["segments"]["per_length"].push_back(std::move(row));
    }
  }
  return json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
}

}  // namespace nilio::tools::evaluate
