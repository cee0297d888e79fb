#include "tools/common/text.hpp"
#include "tools/evaluate/metrics.hpp"

#include <nlohmann/json.hpp>

namespace nilio::tools::evaluate {

namespace {

void append_statistics(std::string& text, const char* name, const char* unit, const Statistics& s) {
  text += format("  %-34s %10.4f %10.4f %10.4f %10.4f %10.4f %10.4f  %s\n", name, s.rmse, s.mean, s.median,
                 s.std, s.min, s.max, unit);
}

void append_segments(std::string& text, const char* name, const std::optional<SegmentErrors>& errors,
                     double truth_length_m) {
  text += format("\n%s\n", name);
  if (!errors) {
    text += format("  none: the path of %.1f m is shorter than the shortest segment\n", truth_length_m);
    return;
  }
  text += format("  %-10s %12s %14s %10s\n", "length", "t_rel %", "r_rel deg/100m", "segments");
  for (const SegmentError& e : errors->per_length) {
    text += format("  %7g m  %12.4f %14.4f %10zu\n", e.length_m, e.translation_percent,
                   e.rotation_deg_per_100m, e.count);
  }
  text += format("  %-10s %12.4f %14.4f %10zu\n", "mean", errors->all.translation_percent,
                 errors->all.rotation_deg_per_100m, errors->all.count);
}

nlohmann::json statistics_json(const Statistics& s) {
  return {{"rmse", s.rmse}, {"mean", s.mean}, {"median", s.median},
          {"std", s.std},   {"min", s.min},   {"max", s.max}};
}

nlohmann::json errors_json(const PoseErrors& errors) {
  return {{"translation_m", statistics_json(errors.translation_m)},
          {"rotation_deg", statistics_json(errors.rotation_deg)}};
}

nlohmann::json segment_json(const SegmentError& e) {
  return {{"translation_percent", e.translation_percent},
          {"rotation_deg_per_100m", e.rotation_deg_per_100m},
          {"segments", e.count}};
}

nlohmann::json segments_json(const std::optional<SegmentErrors>& errors) {
  if (!errors) return nullptr;
  nlohmann::json json = segment_json(errors->all);
  json["per_length"] = nlohmann::json::array();
  for (const SegmentError& e : errors->per_length) {
    nlohmann::json row = segment_json(e);
    row["length_m"] = e.length_m;
    json["per_length"].push_back(std::move(row));
  }
  return json;
}

/// 0 for a stationary estimate or truth.
double length_ratio(const Evaluation& evaluation) {
  return evaluation.truth_length_m > 0.0 ? evaluation.estimate_length_m / evaluation.truth_length_m : 0.0;
}

}  // namespace

const AbsoluteError& absolute_error_of(const Evaluation& evaluation, Alignment alignment) {
  for (const AbsoluteError& error : evaluation.absolute) {
    if (error.alignment == alignment) return error;
  }
  return evaluation.absolute.front();
}

double end_drift_percent(const Evaluation& evaluation, Alignment alignment) {
  if (evaluation.truth_length_m <= 0.0) return 0.0;
  return 100.0 * absolute_error_of(evaluation, alignment).end_translation_m / evaluation.truth_length_m;
}

std::string format_report(const Evaluation& evaluation, const ReportOptions& options) {
  std::string text;
  text += format("poses       %zu associated, unmatched: %zu of the truth, %zu of the estimate\n",
                 evaluation.associated, evaluation.unmatched_truth, evaluation.unmatched_estimate);
  text += format("path        truth %.3f m, estimate %.3f m, ratio %.5f\n", evaluation.truth_length_m,
                 evaluation.estimate_length_m, length_ratio(evaluation));
  const AbsoluteError& chosen = absolute_error_of(evaluation, options.alignment);
  text += format("end drift   %.3f m (%.3f %% of the path), %.3f deg (alignment: %s)\n\n",
                 chosen.end_translation_m, end_drift_percent(evaluation, options.alignment),
                 chosen.end_rotation_deg, alignment_name(options.alignment));
  text +=
      format("  %-34s %10s %10s %10s %10s %10s %10s\n", "", "rmse", "mean", "median", "std", "min", "max");
  for (const AbsoluteError& error : evaluation.absolute) {
    const std::string name = std::string("aligned: ") + alignment_name(error.alignment);
    append_statistics(text, ("APE translation, " + name).c_str(), "m", error.errors.translation_m);
    append_statistics(text, ("APE rotation, " + name).c_str(), "deg", error.errors.rotation_deg);
  }
  append_statistics(text, "RPE translation, per frame", "m", evaluation.relative.translation_m);
  append_statistics(text, "RPE rotation, per frame", "deg", evaluation.relative.rotation_deg);
  if (evaluation.alignment_degenerate) {
    text +=
        "  The positions lie nearly on one line: the rotation of the se3 alignment about it is arbitrary, "
        "and "
        "so are its rotation errors.\n";
  }
  append_segments(text, "Segments (KITTI devkit, every 10th pose)", evaluation.segments,
                  evaluation.truth_length_m);
  append_segments(text, "Short segments (every 5th pose)", evaluation.short_segments,
                  evaluation.truth_length_m);
  return text;
}

std::string format_json(const Evaluation& evaluation, const ReportOptions& options) {
  const AbsoluteError& chosen = absolute_error_of(evaluation, options.alignment);
  nlohmann::json json = {
      {"poses",
       {{"associated", evaluation.associated},
        {"unmatched_truth", evaluation.unmatched_truth},
        {"unmatched_estimate", evaluation.unmatched_estimate}}},
      {"path",
       {{"truth_m", evaluation.truth_length_m},
        {"estimate_m", evaluation.estimate_length_m},
        {"ratio", length_ratio(evaluation)}}},
      {"end_drift",
       {{"alignment", alignment_name(options.alignment)},
        {"translation_m", chosen.end_translation_m},
        {"percent", end_drift_percent(evaluation, options.alignment)},
        {"rotation_deg", chosen.end_rotation_deg}}},
      {"rpe", errors_json(evaluation.relative)},
      {"alignment_degenerate", evaluation.alignment_degenerate},
      {"segments", segments_json(evaluation.segments)},
      {"short_segments", segments_json(evaluation.short_segments)},
  };
  for (const AbsoluteError& error : evaluation.absolute) {
    json["ape"][alignment_name(error.alignment)] = errors_json(error.errors);
  }
  return json.dump(2) + "\n";
}

}  // namespace nilio::tools::evaluate
