#include "daemon/exit_status.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/evaluate/run_table.hpp"
#include "tools/view/page.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

using evaluate::RunRow;
using Format = std::string (*)(const std::vector<RunRow>&);

const std::map<std::string, Format> kFormats{
    {"text", evaluate::run_table_text}, {"csv", evaluate::run_table_csv}, {"json", evaluate::run_table_json}};

struct ReportArguments {
  std::vector<std::string> runs;
  evaluate::RunLimits limits;
  std::string format = "text";
  std::string output;
  std::string html;
  std::vector<std::string> truths;
};

/// A run may be named by its result.json; the page needs the folder.
std::string folder_of(const std::string& run) {
  const std::filesystem::path path(run);
  if (path.filename() != "result.json") return run;
  return path.has_parent_path() ? path.parent_path().string() : ".";
}

bool write_page(const ReportArguments& arguments) {
  view::ReportPageOptions options;
  for (const std::string& run : arguments.runs) options.runs.push_back(folder_of(run));
  options.truths = arguments.truths;
  const auto size = view::write_report_page(options, arguments.html);
  if (size) {
    std::cerr << "nilio report: " << arguments.html << " written, " << (*size + 500'000) / 1'000'000
              << " MB; open it in a browser\n";
    return true;
  }
  std::cerr << "nilio report: " << size.error().message << '\n';
  return false;
}

/// Writes to the file, or to standard output if there is none.
bool write_table(const std::string& table, const std::string& path) {
  if (path.empty()) return static_cast<bool>(std::cout << table << std::flush);
  std::ofstream file(path);
  file << table;
  file.close();
  if (file) return true;
  std::cerr << "nilio report: " << path
            << ": cannot be written - check the folder and the space on the disk\n";
  return false;
}

int run_report(const ReportArguments& arguments) {
  std::vector<RunRow> rows;
  for (const std::string& run : arguments.runs) rows.push_back(evaluate::read_run(run, arguments.limits));
  if (!arguments.html.empty() && !write_page(arguments)) return kFailed;
  if (arguments.html.empty() && !arguments.truths.empty()) {
    std::cerr << "nilio report: --truth is for the page - add --html FILE\n";
    return kFailed;
  }
  if (!write_table(kFormats.at(arguments.format)(rows), arguments.output)) return kFailed;
  const auto bad =
      std::count_if(rows.begin(), rows.end(), [](const RunRow& row) { return !row.problem.empty(); });
  if (bad == 0) return kDone;
  std::cerr << "nilio report: " << bad << " of " << rows.size() << " runs have a problem\n";
  return kBadResult;
}

}  // namespace

void add_report_command(CLI::App& app, int& status) {
  const auto arguments = std::make_shared<ReportArguments>();
  CLI::App* const command = app.add_subcommand(
      "report", "join the results of many replays into one table, check them, and make a page of them");
  command->footer(
      "RUN is an output folder of niliod, or its result.json, which a replay writes when it has processed "
      "its "
      "whole recording. The same recording, configuration hash and version give the same trajectory "
      "(trajectory_sha256).\n\n"
      "Example: niliod --replay DRIVE --output RUNS/DRIVE for every DRIVE, then\n"
      "  nilio report RUNS/* --max-lost 1 --format csv --output table.csv\n"
      "  nilio report RUN --truth DRIVE/truth.tum --html report.html");
  command->add_option("RUN", arguments->runs, "folders or result.json files")->required();
  command
      ->add_option("--max-lost", arguments->limits.max_lost_percent,
                   "limit on lost poses, % of a run's poses")
      ->check(number_between(0.0, 100.0));
  command
      ->add_option("--max-resets", arguments->limits.max_resets,
                   "limit on map resets after initialisation and relocalisations of a run")
      ->check(number_between(0.0, 1e9));
  command->add_option("--format", arguments->format, "text, csv or json")
      ->check(CLI::IsMember(kFormats))
      ->capture_default_str();
  command->add_option("--output", arguments->output, "file for the table instead of standard output");
  command->add_option(
      "--html", arguments->html,
      "also write one HTML file with map, trajectories, errors and latencies of the runs, which "
      "needs no network (less than 20 MB)");
  command->add_option("--truth", arguments->truths,
                      "with --html: true trajectory, TUM or KITTI: one for all runs, or one for each");
  command->callback([arguments, &status] { status = run_report(*arguments); });
}

}  // namespace nilio::tools
