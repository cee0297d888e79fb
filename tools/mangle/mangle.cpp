#include "tools/mangle/mangle.hpp"

#include "daemon/input/kitti_sequence.hpp"
#include "daemon/input/replay_files.hpp"
#include "tools/common/files.hpp"

#include <array>
#include <sstream>
#include <system_error>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::mangle {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

using Rows = std::vector<std::pair<const char*, std::uint64_t>>;

Rows rows_of(const Summary& s) {
  return {{"packets read", s.packets.packets},
          {"packets written", s.packets.written},
          {"lost in gaps", s.packets.lost_in_gaps},
          {"lost", s.packets.lost},
          {"lost in bursts", s.packets.lost_in_bursts},
          {"duplicated", s.packets.duplicated},
          {"pairs reordered", s.packets.reordered},
          {"with another receive time", s.packets.restamped},
          {"scans", s.scans},
          {"scans dropped", s.scans_dropped},
          {"returns", s.returns.returns},
          {"returns kept", s.returns.kept},
          {"of other rings", s.returns.other_rings},
          {"outside the field of view", s.returns.outside_view},
          {"not vegetation", s.returns.not_vegetation},
          {"thinned out", s.returns.thinned},
          {"ghosts", s.returns.ghosts}};
}

/// Creates the folder, which must not hold anything.
Result<std::monostate> prepare_output(const std::string& output) {
  std::error_code error;
  fs::create_directories(output, error);
  if (error) return Error{output + ": cannot be created (" + error.message() + ") - choose another folder"};
  if (fs::is_empty(output, error) && !error) return std::monostate{};
  return Error{
      output +
      ": is not an empty folder - choose another one, so that no file of an earlier recording stays"};
}

Result<std::monostate> write_summary(const Options& options, const Summary& summary) {
  nlohmann::ordered_json json{{"input", fs::path(options.input).filename().string()},
                              {"options", to_options(options.faults)}};
  for (const auto& [name, count] : rows_of(summary)) json["counts"][name] = count;
  const fs::path path = fs::path(options.output) / "mangle.json";
  return write_text(path, json.dump(2) + '\n');
}

}  // namespace

std::string to_text(const Summary& summary) {
  std::ostringstream text;
  for (const auto& [name, count] : rows_of(summary)) {
    if (count > 0) text << name << ": " << count << '\n';
  }
  return text.str();
}

Result<Summary> mangle(const Options& options) {
  if (auto checked = check_faults(options.faults); !checked) return checked.error();
  const auto files = daemon::find_replay_files({options.input});
  if (!files) return files.error();
  if (!files->bags.empty())
    return Error{files->bags.front() + ": is a ROS bag - give a capture or a KITTI sequence"};
  if (auto prepared = prepare_output(options.output); !prepared) return prepared.error();
  Result<Summary> summary =
      files->captures.empty() ? mangle_kitti(files->kitti_sequence, options) : mangle_packets(options);
  if (!summary) return summary;
  if (auto written = write_summary(options, *summary); !written) return written.error();
  return summary;
}

}  // namespace nilio::tools::mangle
