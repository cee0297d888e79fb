#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

namespace nilio::tools::view {

/// The page of this build, compressed by gzip; empty where it was left out for lack of npm.
std::shared_ptr<const std::string> compressed_page();

/// Why there is no page, for messages.
std::string page_missing_message();

/// Content-Security-Policy of the page as it is served.
std::string page_security_policy();

/// A block of data inside a page that is opened from disk.
struct PageData {
  std::string id;
  std::string content;
};

/// The page as one HTML file with its data inside, for reading without a server. Ends with a marker, so that
/// a file that was cut is recognised. Fails where the build has no page.
core::Result<std::string> page_with_data(const std::vector<PageData>& data);

struct ReportPageOptions {
  std::vector<std::string> runs;
  std::vector<std::string> truths;  ///< none, one for all, or one for each
  std::size_t max_bytes = 20'000'000;
};

/// Writes the page with the runs inside as one HTML file, which has its name only when it is complete. Map
/// points are thinned until it fits. Returns its size.
core::Result<std::size_t> write_report_page(const ReportPageOptions& options, const std::string& path);

}  // namespace nilio::tools::view
