#pragma once

#include "nilio/core/result.hpp"

#include "bench_table.hpp"
#include "plot_canvas.hpp"

#include <string>
#include <variant>

namespace nilio::tools {

/// Measurements on their way out: to standard output as they come and, if a folder is given, to a page of
/// Markdown with pictures.
class ResultsPage {
 public:
  /// An empty folder: standard output only. Fails when the folder cannot be made.
  static core::Result<ResultsPage> create(const std::string& folder, const std::string& title);

  void heading(const std::string& text);
  void paragraph(const std::string& text);
  void table(const std::string& title, const BenchTable& table);
  [[nodiscard]] bool wants_pictures() const { return !folder_.empty(); }
  /// Where a picture of this name belongs, a new canvas for it.
  [[nodiscard]] core::Result<Canvas> new_picture(const std::string& name, int width, int height) const;
  /// Saves a drawn picture and puts it on the page.
  core::Result<std::monostate> picture(const std::string& name, const std::string& caption, Canvas& canvas);
  /// Writes results.md.
  [[nodiscard]] core::Result<std::monostate> save() const;

 private:
  std::string folder_;
  std::string text_;
};

}  // namespace nilio::tools
