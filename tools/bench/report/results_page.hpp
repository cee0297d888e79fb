#pragma once

#include "nilio/core/result.hpp"

#include "tools/plot/figure.hpp"

#include <string>
#include <variant>
#include <vector>

namespace nilio::tools::bench {

/// Rows of text under headings; the first column is aligned left, the others right.
struct Table {
  std::vector<std::string> headings;
  std::vector<std::vector<std::string>> rows;
};

/// Aligned columns for a terminal.
std::string to_text(const Table& table);
std::string to_markdown(const Table& table);

/// A number with that many decimals; "-" when it is not finite.
std::string fixed(double value, int digits);

/// Command line of this process, quoted where a shell needs it.
std::string current_command_line();

/// Report of a benchmark: printed as it grows and, if a folder is given, written as a page of Markdown with
/// figures (a picture and its data as CSV). The page begins with the command line, the machine and the
/// version.
class ResultsPage {
 public:
  struct Options {
    std::string folder;                  ///< empty: standard output only
    std::string file = "results.md";     ///< name of the page in `folder`
    std::string picture_format = "svg";  ///< or "png"
  };

  /// Fails when the folder cannot be created.
  static core::Result<ResultsPage> create(const Options& options, const std::string& title);

  void heading(const std::string& text);
  void paragraph(const std::string& text);
  /// Tables without rows are left out.
  void table(const std::string& title, const Table& table);
  /// Adds the figure and writes NAME.svg (or .png) and NAME.csv. Does nothing without a folder or without
  /// curves.
  core::Result<std::monostate> figure(const std::string& name, const std::string& caption,
                                      const plot::Figure& figure, int width, int height);
  /// Writes the page.
  [[nodiscard]] core::Result<std::monostate> save() const;

 private:
  Options options_;
  std::string text_;
};

}  // namespace nilio::tools::bench
