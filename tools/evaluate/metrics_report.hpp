#pragma once

#include "tools/evaluate/metrics.hpp"

#include <string>

namespace nilio::tools::evaluate {

/// Choices of the user.
struct ReportOptions {
  /// Alignment for the end drift.
  Alignment alignment = Alignment::kOrigin;
};

/// Distance between the last poses under the chosen alignment in percent of the truth's path; 0 for a truth
/// at rest.
double end_drift_percent(const Evaluation& evaluation, Alignment alignment);

/// The row of `evaluation.absolute` with this alignment; the evaluation must have it.
const AbsoluteError& absolute_error_of(const Evaluation& evaluation, Alignment alignment);

/// Tables for a terminal.
std::string format_report(const Evaluation& evaluation, const ReportOptions& options);

/// The same numbers in full precision; keys contain the units.
std::string format_json(const Evaluation& evaluation, const ReportOptions& options);

}  // namespace nilio::tools::evaluate
