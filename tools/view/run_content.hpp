#pragma once

#include "nilio/core/result.hpp"

#include "tools/view/page.hpp"
#include "tools/view/run_document.hpp"
#include "tools/view/server.hpp"

#include <map>
#include <string>
#include <vector>

namespace nilio::tools::view {

/// Finished runs side by side: the blocks "runs" (JSON) and "map0", "map1", ... that both the served page
/// and the report have. `truths`: none, one for all, or one for each run.
core::Result<std::vector<PageData>> run_blocks(const std::vector<std::string>& folders,
                                               const std::vector<std::string>& truths,
                                               const RunDocumentOptions& options);

/// Serves finished runs.
class RunContent : public Content {
 public:
  explicit RunContent(const std::vector<PageData>& blocks);
  std::optional<Response> get(std::string_view path, std::string_view accept) override;
  FramePtr next_frame(PageClient&) override { return nullptr; }
  void tick(std::vector<PageClient*>&) override {}

 private:
  std::map<std::string, Response, std::less<>> table_;
};

/// The page at "/", or the reason why there is none.
Response page_response();

}  // namespace nilio::tools::view
