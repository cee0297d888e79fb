#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/odometry/table.hpp"
#include "tools/commands/command_line_fwd.hpp"
#include "tools/plot/canvas.hpp"

#include <string>
#include <variant>

namespace nilio::tools {

/// Measurements on their way out: to standard output as they come and, if a folder is given, to a page of
/// Markdown with pictures.
class ResultsPage {
 public:
  struct Options {
    std::string folder;                  ///< empty: standard output only
    std::string file = "results.md";     ///< of the page, in `folder`
    std::string picture_format = "svg";  ///< or "png"
  };

  /// Fails when the folder cannot be made.
  static core::Result<ResultsPage> create(const Options& options, const std::string& title);

  void heading(const std::string& text);
  void paragraph(const std::string& text);
  void table(const std::string& title, const BenchTable& table);
  [[nodiscard]] bool wants_pictures() const { return !options_.folder.empty(); }
  /// A canvas for the picture of this name, which has no extension.
  [[nodiscard]] core::Result<Canvas> new_picture(const std::string& name, int width, int height) const;
  /// Saves a drawn picture and puts it on the page.
  core::Result<std::monostate> picture(const std::string& name, const std::string& caption, Canvas& canvas);
  /// Writes the page.
  [[nodiscard]] core::Result<std::monostate> save() const;

 private:
  Options options_;
  std::string text_;
};

/// --output, --page and --pictures.
void add_page_options(CLI::App& command, ResultsPage::Options& options);

}  // namespace nilio::tools
