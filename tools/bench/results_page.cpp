#include "tools/bench/results_page.hpp"

#include "tools/bench/odometry/report.hpp"

#include <cstdio>
#include <filesystem>
#include <fstream>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

}  // namespace

Result<ResultsPage> ResultsPage::create(const Options& options, const std::string& title) {
  ResultsPage page;
  page.options_ = options;
  if (options.folder.empty()) return page;
  std::error_code error;
  fs::create_directories(options.folder, error);
  if (error)
    return Error{options.folder + ": cannot be made (" + error.message() + "): choose another --output"};
  page.text_ =
      "# " + title + "\n\nMade by\n\n```sh\n" + command_line() + "\n```\n\non " + describe_machine() + ".\n";
  return page;
}

void ResultsPage::heading(const std::string& text) {
  std::printf("\n== %s\n", text.c_str());
  text_ += "\n## " + text + "\n";
}

void ResultsPage::paragraph(const std::string& text) {
  std::printf("\n%s\n", text.c_str());
  std::fflush(stdout);
  text_ += "\n" + text + "\n";
}

void ResultsPage::table(const std::string& title, const BenchTable& table) {
  if (table.rows.empty()) return;
  std::printf("\n%s\n%s", title.c_str(), to_text(table).c_str());
  std::fflush(stdout);
  text_ += "\n### " + title + "\n\n" + to_markdown(table);
}

Result<Canvas> ResultsPage::new_picture(const std::string& name, int width, int height) const {
  return Canvas::create((fs::path(options_.folder) / (name + "." + options_.picture_format)).string(), width,
                        height);
}

Result<std::monostate> ResultsPage::picture(const std::string& name, const std::string& caption,
                                            Canvas& canvas) {
  const auto saved = canvas.save();
  if (!saved) return saved.error();
  text_ += "\n![" + caption + "](" + name + "." + options_.picture_format + ")\n\n" + caption + "\n";
  return std::monostate{};
}

void add_page_options(CLI::App& command, ResultsPage::Options& options) {
  CLI::Option* const folder =
      command.add_option("--output", options.folder, "folder for results.md and its pictures");
  command
      .add_option_function<std::string>(
          "--page",
          [&options](const std::string& given) {
            const fs::path page = fs::absolute(given);
            options.folder = page.parent_path().string();
            options.file = page.filename().string();
          },
          "file for the page instead, with its pictures beside it")
      ->excludes(folder);
  command.add_option("--pictures", options.picture_format, "format of the pictures")
      ->check(CLI::IsMember({"svg", "png"}))
      ->capture_default_str();
}

Result<std::monostate> ResultsPage::save() const {
  if (options_.folder.empty()) return std::monostate{};
  const fs::path path = fs::path(options_.folder) / options_.file;
  std::ofstream file(path);
  file << text_;
  if (!file.flush())
    return Error{path.string() + ": cannot be written: check the folder and the space on the disk"};
  std::printf("\n%s\n", path.c_str());
  return std::monostate{};
}

}  // namespace nilio::tools
