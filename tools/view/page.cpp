#include "tools/view/page.hpp"

#include "tools/common/files.hpp"
#include "tools/view/http_request.hpp"
#include "tools/view/run_content.hpp"

#include <algorithm>
#include <fstream>
#include <openssl/evp.h>
#include <string_view>

#ifdef NILIO_VIEW_PAGE
// The compressed page as read-only data of the program.
asm(".section .rodata\n"
    ".global nilio_view_page_begin\n"
    ".global nilio_view_page_end\n"
    ".balign 16\n"
    "nilio_view_page_begin:\n"
    ".incbin \"" NILIO_VIEW_PAGE
    "\"\n"
    "nilio_view_page_end:\n"
    ".byte 0\n"
    ".previous\n");
extern "C" const char nilio_view_page_begin[];
extern "C" const char nilio_view_page_end[];
#endif

namespace nilio::tools::view {

namespace {

constexpr std::string_view kDataMarker = "<!--nilio-data-->";
// Map points of a report: of all runs at first, and of each at least.
constexpr std::size_t kFirstPoints = 2'000'000;
constexpr std::size_t kFewestPoints = 1000;
constexpr std::string_view kEndMarker = "<!--nilio-end-->\n";

std::string base64(const std::string& bytes) {
  std::string text(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int length =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                      reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  return text;
}

}  // namespace

std::shared_ptr<const std::string> compressed_page() {
#ifdef NILIO_VIEW_PAGE
  static const auto page = std::make_shared<const std::string>(nilio_view_page_begin, nilio_view_page_end);
  return page;
#else
  return std::make_shared<const std::string>();
#endif
}

std::string page_missing_message() {
  return "this build has no page: npm was not found when it was configured - install nodejs and npm, and "
         "build again";
}

std::string page_security_policy() {
  // The page itself names its script and style by their hashes.
  return "frame-ancestors 'none'; base-uri 'none'; form-action 'none'";
}

core::Result<std::string> page_with_data(const std::vector<PageData>& data) {
  const auto compressed = compressed_page();
  if (compressed->empty()) return core::Error{page_missing_message()};
  auto page = gunzip(*compressed);
  if (!page) return page.error();
  std::string blocks;
  // Base64 of gzip: nothing in it can end the element, and the browser does not run it.
  for (const PageData& block : data)
    blocks += "<script type=\"application/octet-stream\" id=\"" + block.id + "\">" +
              base64(gzip(block.content)) + "</script>\n";
  const std::size_t at = page->find(kDataMarker);
  if (at == std::string::npos) return core::Error{"the page of this build has no place for data"};
  page->replace(at, kDataMarker.size(), blocks);
  return *page + std::string(kEndMarker);
}

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
  if (!file) return cannot_write(path);
  if (auto finished = unfinished.finish(); !finished) return finished.error();
  return page.size();
}

}  // namespace nilio::tools::view
