#include "tools/view/report_page.hpp"

#include "tools/common/files.hpp"
#include "tools/view/page.hpp"
#include "tools/view/run_content.hpp"

#include <algorithm>
#include <fstream>

namespace nilio::tools::view {

namespace {

constexpr std::size_t kFirstPoints = 2'000'000;
constexpr std::size_t kFewestPoints = 1000;

}  // namespace

core::Result<std::size_t> write_report_page(const ReportPageOptions& options, const std::string& path) {
  RunDocumentOptions document;
  document.max_map_points =
      std::max<std::size_t>(kFirstPoints / std::max<std::size_t>(options.runs.size(), 1), 1);
  std::string page;
  while (true) {
    const auto blocks = run_blocks(options.runs, options.truths, document);
    if (!blocks) return blocks.error();
    auto made = page_with_data(*blocks);
    if (!made) return made.error();
    page = std::move(made).value();
    if (page.size() <= options.max_bytes) break;
    if (document.max_map_points <= kFewestPoints)
      return core::Error{path + ": the runs do not fit into " + std::to_string(options.max_bytes) +
                         " bytes even without their maps - report fewer of them"};
    const double share = static_cast<double>(options.max_bytes) / static_cast<double>(page.size());
    document.max_map_points = std::max(
        kFewestPoints, static_cast<std::size_t>(0.8 * share * static_cast<double>(document.max_map_points)));
  }
  const UnfinishedFile unfinished(path);
  std::ofstream file(unfinished.path(), std::ios::binary);
  file << page;
  file.close();
  if (!file) return core::Error{path + ": cannot be written - check the folder and the space on the disk"};
  if (auto finished = unfinished.finish(); !finished) return finished.error();
  return page.size();
}

}  // namespace nilio::tools::view
