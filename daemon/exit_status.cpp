#include "daemon/exit_status.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

namespace nilio {

namespace {

/// Causes of each status of one command; nullptr: the command never ends with it.
struct Row {
  std::string_view command;
  const char* done;
  const char* failed;
  const char* missed;
};

constexpr std::size_t kColumns = 100;
constexpr const char* kUsage = "unknown, missing or contradictory options; niliod: an invalid configuration";

constexpr std::array kRows{
    Row{"niliod",
        "the recording was replayed to its end and tracking was kept; a live run was stopped by a signal",
        "an input or the output cannot be used; the files are incomplete; a replay was stopped by a signal "
        "before its end",
        "replay: tracking is lost at the end, the map was reset after its first scans, or tracking was lost "
        "at more than 5 % of the poses; nilio-publisher could not start, so that nothing was published"},
    Row{"nilio-publisher", "stopped by a signal, all poses written",
        "the DDS participant, a topic or an inherited descriptor cannot be used", nullptr},
    Row{"nilio-mapper", "stopped by a signal, the map is complete",
        "the folder, an inherited descriptor or the disk cannot be used", nullptr},
    Row{"nilio record", "recorded", "no data were recorded, or the disk did not take all of them", nullptr},
    Row{"nilio play", "played", "a packet or frame could not be sent", nullptr},
    Row{"nilio simulate", "the recording is written", "a file cannot be read or written", nullptr},
    Row{"nilio mangle", "the copy is written",
        "a file cannot be read or written, or the recording cannot have the fault", nullptr},
    Row{"nilio convert", "converted", "a file cannot be read or written, or nothing was written", nullptr},
    Row{"nilio evaluate", "compared", "a file cannot be used, or a threshold cannot be checked",
        "a --max-... threshold is exceeded"},
    Row{"nilio report", "every run has a result and keeps every threshold", "the table cannot be written",
        "a run has no readable result or its own status is not 0, or a --max-... threshold is exceeded"},
    Row{"nilio init", "the configuration is written",
        "nothing was received or found, or the file could not be written", nullptr},
    Row{"nilio inspect", "at least one file is usable", "no file is usable, or a file could not be written",
        nullptr},
    Row{"nilio map", "done", "a map is damaged or none, or a file cannot be written", nullptr},
    Row{"nilio plot", "drawn", "a file cannot be read or written", nullptr},
    Row{"nilio watch", "poses were received", "no pose was received, or a file could not be written",
        nullptr},
    Row{"nilio view", "stopped by SIGTERM; Ctrl-C: 130",
        "a run, the truth, the token, the address or the port cannot be used", nullptr},
    Row{"nilio bench", "measured; every requirement that does not depend on the clock is met",
        "something could not be run",
        "such a requirement is not met, memory grows, or counters do not add up"},
    Row{"nilio reference", "printed", "never", nullptr}};

/// "  0  done: cause ...", broken at kColumns.
std::string lines_of(int status, std::string text, const char* causes) {
  const std::string indent(5, ' ');
  std::string lines;
  std::string line = "  " + std::to_string(status) + "  " + std::move(text);
  if (causes != nullptr) line += std::string(": ") + causes;
  while (line.size() > kColumns) {
    const std::size_t space = line.find_last_of(' ', kColumns);
    lines += line.substr(0, space) + "\n";
    line = indent + line.substr(space + 1);
  }
  return lines + line + "\n";
}

}  // namespace

std::string exit_status_help(std::string_view command) {
  const auto* row =
      std::find_if(kRows.begin(), kRows.end(), [&](const Row& r) { return r.command == command; });
  const bool is_general = row == kRows.end();
  std::string text = "Exit status:\n";
  text += lines_of(kDone, "done", is_general ? nullptr : row->done);
  text += lines_of(kFailed, "failed, with one message", is_general ? nullptr : row->failed);
  text += lines_of(kUsageError, "wrong usage", kUsage);
  if (is_general || row->missed != nullptr)
    text += lines_of(kBadResult, "done, but a threshold is missed", is_general ? nullptr : row->missed);
  text.pop_back();
  return text;
}

std::string exit_status_reference() {
  std::string text =
      "<!-- Generated: nilio reference exit-status > docs/exit_status.md -->\n\n"
      "# Exit statuses\n\n"
      "Status 2 is wrong usage for every command: " +
      std::string(kUsage) +
      ".\nWith status 1, 2 or 3 the last line on standard error says why. A scheduler may repeat a run that "
      "ended "
      "with 1 or by a\nsignal; 2 and 3 come again with the same files. A process that a signal ends has no "
      "status "
      "(a shell shows 128 + signal).\n\n"
      "| command | 0: done | 1: failed | 3: done, but a threshold is missed |\n|---|---|---|---|\n";
  for (const Row& row : kRows)
    text += "| `" + std::string(row.command) + "` | " + row.done + " | " + row.failed + " | " +
            (row.missed == nullptr ? "-" : row.missed) + " |\n";
  text +=
      "\n`nilio-publisher` is started by `niliod`. Its status 75 asks `niliod` to start it again: a listed "
      "DDS "
      "interface appeared.\n";
  return text;
}

}  // namespace nilio
