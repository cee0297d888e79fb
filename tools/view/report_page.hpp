#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <string>
#include <vector>

namespace nilio::tools::view {

struct ReportPageOptions {
  std::vector<std::string> runs;
  std::vector<std::string> truths;  ///< none, one for all, or one for each
  std::size_t max_bytes = 20'000'000;
};

/// Writes the page with the runs inside as one HTML file, which has its name only when it is complete. Map
/// points are thinned until it fits. Returns its size.
core::Result<std::size_t> write_report_page(const ReportPageOptions& options, const std::string& path);

}  // namespace nilio::tools::view
