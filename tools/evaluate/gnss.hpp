#pragma once

#include "tools/gnss/georeference.hpp"
#include "tools/gnss/track.hpp"

#include <cstddef>
#include <optional>
#include <string>
#include <vector>

namespace nilio::tools::evaluate {

/// Distances between positions, metres.
struct PositionErrors {
  double rmse = 0.0;
  double median = 0.0;
  double p95 = 0.0;
  double maximum = 0.0;
};

/// Error of displacements over a length of the estimate's path, horizontal, mean over all starting points.
struct DisplacementError {
  double length_m = 0.0;
  double percent = 0.0;
  /// Part of the stated deviations, if positions are independent; empty where none are stated.
  std::optional<double> stated_percent;
  std::size_t count = 0;
};

/// A trajectory against the track of a GNSS receiver: horizontal and vertical, for a track has no attitude.
struct GnssEvaluation {
  std::size_t positions = 0;
  std::size_t unmatched = 0;
  double path_m = 0.0;  ///< of the estimate between the first and the last match
  PositionErrors horizontal;
  std::optional<PositionErrors> vertical;
  /// Errors that the stated deviations alone would make.
  std::optional<double> stated_horizontal_rmse_m;
  std::optional<double> stated_vertical_rmse_m;
  /// Lengths that occur, and the mean over all of them.
  std::vector<DisplacementError> per_length;
  std::optional<DisplacementError> all;
};

/// `lengths_m`: of the displacements; empty: 100 to 800 m, or 10 to 80 m for shorter paths.
GnssEvaluation evaluate_gnss(const gnss::Georeference& georeference, const gnss::Track& track,
                             std::vector<double> lengths_m);

/// Tables for a terminal, and the same numbers as JSON.
std::string gnss_report(const GnssEvaluation& evaluation, const gnss::Georeference& georeference,
                        const gnss::Track& track);
std::string gnss_json(const GnssEvaluation& evaluation, const gnss::Georeference& georeference,
                      const gnss::Track& track);

}  // namespace nilio::tools::evaluate
