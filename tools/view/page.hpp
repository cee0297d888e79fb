#pragma once

#include "nilio/core/result.hpp"

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

}  // namespace nilio::tools::view
