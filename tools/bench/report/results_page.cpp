#include "tools/bench/report/results_page.hpp"

#include "tools/common/files.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <sys/utsname.h>
#include <thread>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

std::string processor() {
  std::ifstream info("/proc/cpuinfo");
  std::string line;
  while (std::getline(info, line)) {
    const std::size_t colon = line.find(": ");
    if (line.starts_with("model name") && colon != std::string::npos) return line.substr(colon + 2);
  }
  return "unknown processor";
}

/// Machine, compiler, version and date.
std::string describe_machine() {
  utsname system{};
  uname(&system);
  std::array<char, 32> date{};
  const std::time_t now = std::time(nullptr);
  tm broken_down{};
  std::strftime(date.data(), date.size(), "%Y-%m-%d", gmtime_r(&now, &broken_down));
  return processor() + ", " + std::to_string(std::thread::hardware_concurrency()) + " cores; " +
         system.sysname + " " + system.release + "; g++ " + __VERSION__ + "; nilio " NILIO_VERSION "; " +
         date.data();
}

}  // namespace

std::string current_command_line() {
  std::ifstream file("/proc/self/cmdline", std::ios::binary);
  std::string line;
  std::string word;
  while (std::getline(file, word, '\0')) {
    if (!line.empty()) line += ' ';
    const bool plain = !word.empty() && word.find_first_of(" \t\n'\"\\$&;|<>*?()`#~") == std::string::npos;
    line += plain ? word : "'" + word + "'";
  }
  return line;
}

std::string to_text(const Table& table) {
  std::vector<std::size_t> widths;
  for (const std::string& heading : table.headings) widths.push_back(heading.size());
  for (const auto& row : table.rows) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string text;
  const auto add_row = [&](const std::vector<std::string>& row) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      const std::string padding(widths[i] - row[i].size(), ' ');
      text += i == 0 ? row[i] + padding : "  " + padding + row[i];
    }
    text += '\n';
  };
  add_row(table.headings);
  for (const auto& row : table.rows) add_row(row);
  return text;
}

std::string to_markdown(const Table& table) {
  std::string text = "|";
  for (const std::string& heading : table.headings) text += " " + heading + " |";
  text += "\n|";
  for (std::size_t i = 0; i < table.headings.size(); ++i) text += i == 0 ? "---|" : "---:|";
  text += '\n';
  for (const auto& row : table.rows) {
    text += "|";
    for (const std::string& cell : row) text += " " + cell + " |";
    text += '\n';
  }
  return text;
}

std::string fixed(double value, int digits) {
  if (!std::isfinite(value)) return "-";
  std::array<char, 64> text{};
  std::snprintf(text.data(), text.size(), "%.*f", digits, value);
  return text.data();
}

Result<ResultsPage> ResultsPage::create(const Options& options, const std::string& title) {
  ResultsPage page;
  page.options_ = options;
  if (options.folder.empty()) return page;
  std::error_code error;
  fs::create_directories(options.folder, error);
  if (error)
    return Error{options.folder + ": cannot be created (" + error.message() + ") - choose another --output"};
  page.text_ = "# " + title + "\n\nMade by\n\n```sh\n" + current_command_line() + "\n```\n\non " +
               describe_machine() + ".\n";
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

void ResultsPage::table(const std::string& title, const Table& table) {
  if (table.rows.empty()) return;
  std::printf("\n%s\n%s", title.c_str(), to_text(table).c_str());
  std::fflush(stdout);
  text_ += "\n### " + title + "\n\n" + to_markdown(table);
}

Result<std::monostate> ResultsPage::figure(const std::string& name, const std::string& caption,
                                           const plot::Figure& figure, int width, int height) {
  const bool is_empty = std::all_of(figure.panels.begin(), figure.panels.end(),
                                    [](const plot::Panel& panel) { return panel.curves.empty(); });
  if (options_.folder.empty() || is_empty) return std::monostate{};
  const std::string picture = name + "." + options_.picture_format;
  const fs::path folder(options_.folder);
  if (const auto saved = plot::save_figure(figure, (folder / picture).string(), width, height); !saved)
    return saved.error();
  if (auto saved = write_text(folder / (name + ".csv"), plot::figure_csv(figure)); !saved) return saved;
  text_ += "\n![" + caption + "](" + picture + ")\n\n" + caption + " ([data](" + name + ".csv))\n";
  return std::monostate{};
}

Result<std::monostate> ResultsPage::save() const {
  if (options_.folder.empty()) return std::monostate{};
  const fs::path path = fs::path(options_.folder) / options_.file;
  if (auto written = write_text(path, text_); !written) return written;
  std::printf("\n%s\n", path.c_str());
  return std::monostate{};
}

}  // namespace nilio::tools::bench
