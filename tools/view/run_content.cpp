#include "tools/view/run_content.hpp"

#include "tools/view/http_request.hpp"

#include <utility>

namespace nilio::tools::view {

Response page_response() {
  const auto page = compressed_page();
  if (page->empty())
    return {.content_type = "text/plain; charset=utf-8",
            .body = std::make_shared<const std::string>("nilio view: " + page_missing_message() + "\n"),
            .security_policy = {}};
  return {.content_type = "text/html; charset=utf-8",
          .body = page,
          .gzip = true,
          .security_policy = page_security_policy()};
}

core::Result<std::vector<PageData>> run_blocks(const std::vector<std::string>& folders,
                                               const std::vector<std::string>& truths,
                                               const RunDocumentOptions& options) {
  if (truths.size() > 1 && truths.size() != folders.size())
    return core::Error{"--truth: " + std::to_string(truths.size()) + " files for " +
                       std::to_string(folders.size()) + " runs - give one for all, or one for each"};
  nlohmann::json runs = nlohmann::json::array();
  std::vector<PageData> blocks;
  for (std::size_t i = 0; i < folders.size(); ++i) {
    RunDocumentOptions of_run = options;
    if (!truths.empty()) of_run.truth_path = truths[truths.size() == 1 ? 0 : i];
    auto run = read_run_document(folders[i], of_run);
    if (!run) return run.error();
    runs.push_back(std::move(run->json));
    blocks.push_back({"map" + std::to_string(i), std::move(run->map)});
  }
  const nlohmann::json document{{"format", 1}, {"version", NILIO_VERSION}, {"runs", std::move(runs)}};
  blocks.insert(blocks.begin(),
                {"runs", document.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace)});
  return blocks;
}

RunContent::RunContent(const std::vector<PageData>& blocks) {
  table_["/"] = page_response();
  table_["/mode.json"] = {.content_type = "application/json",
                          .body = std::make_shared<const std::string>(R"({"mode":"runs"})"),
                          .security_policy = {}};
  for (const PageData& block : blocks)
    table_["/data/" + block.id] = {
        .content_type = block.id == "runs" ? "application/json" : "application/octet-stream",
        .body = std::make_shared<const std::string>(gzip(block.content)),
        .gzip = true,
        .security_policy = {}};
}

std::optional<Response> RunContent::get(std::string_view path, std::string_view /*accept*/) {
  const auto entry = table_.find(path);
  if (entry == table_.end()) return std::nullopt;
  return entry->second;
}

}  // namespace nilio::tools::view
