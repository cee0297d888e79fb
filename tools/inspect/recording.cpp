#include "tools/inspect/recording.hpp"

#include "nilio/drivers/bag/bag.hpp"
#include "nilio/drivers/capture/file_kind.hpp"

#include "daemon/input/bag_input.hpp"
#include "tools/common/text.hpp"
#include "tools/gnss/track.hpp"

#include <algorithm>
#include <filesystem>
#include <limits>
#include <set>

namespace nilio::tools::inspect {

namespace {

namespace fs = std::filesystem;
using drivers::FileKind;

void add_bag(const std::vector<std::string>& files, RecordingFindings& findings) {
  core::Result<BagFindings> bag = inspect_bag(files);
  if (!bag) {
    findings.problems.push_back(bag.error().message);
    return;
  }
  if (!bag->usable()) findings.problems.push_back(bag->problem);
  findings.bags.push_back(std::move(bag).value());
}

void inspect_file(const fs::path& path, bool named_by_user, const drivers::DbcDatabase* dbc,
                  RecordingFindings& findings) {
  // run.mcap is an output of niliod.
  if (path.filename() == "run.mcap" && !named_by_user) return;
  const FileKind kind = drivers::file_kind(path.string());
  std::error_code error;
  const bool is_empty = fs::is_regular_file(path, error) && fs::file_size(path, error) == 0 && !error;
  if (kind == FileKind::kOther || kind == FileKind::kCompressed || is_empty) {
    const bool unfinished = path.extension() == drivers::kPartialSuffix;
    if (named_by_user || unfinished || kind != FileKind::kOther)
      findings.problems.push_back(path.string() + ": " + drivers::why_no_recording(path.string()));
    return;
  }
  if (kind == FileKind::kBag) {
    add_bag({path.string()}, findings);
    return;
  }
  if (kind == FileKind::kCapture) {
    core::Result<CaptureFindings> capture = inspect_capture(path.string());
    if (!capture) {
      findings.problems.push_back(capture.error().message);
      return;
    }
    if (!capture->usable()) findings.problems.push_back(why_unusable(*capture));
    findings.captures.push_back(std::move(capture).value());
    return;
  }
  core::Result<CanFindings> can = inspect_can_log(path.string(), dbc);
  if (!can) {
    findings.problems.push_back(can.error().message);
    return;
  }
  if (!can->usable()) findings.problems.push_back(why_unusable(*can));
  findings.can_logs.push_back(std::move(can).value());
}

void inspect_folder(const fs::path& folder, const drivers::DbcDatabase* dbc, RecordingFindings& findings) {
  std::error_code code;
  if (fs::exists(folder / "metadata.yaml", code)) {
    const auto files = drivers::bag_files(folder.string());
    if (files) {
      add_bag(*files, findings);
    } else {
      findings.problems.push_back(files.error().message);
    }
    return;
  }
  std::set<fs::path> entries;
  for (fs::directory_iterator entry(folder, code), end; !code && entry != end; entry.increment(code))
    if (entry->is_regular_file(code)) entries.insert(entry->path());
  const auto found = [&] {
    return findings.captures.size() + findings.can_logs.size() + findings.bags.size() +
           findings.problems.size();
  };
  const std::size_t before = found();
  for (const fs::path& entry : entries) inspect_file(entry, false, dbc, findings);
  if (code) {
    findings.problems.push_back(folder.string() + ": cannot be read (" + code.message() + ")");
  } else if (before == found()) {
    findings.problems.push_back(
        folder.string() + ": no capture (pcap, pcapng), ROS bag or CAN log (candump -L) in this folder");
  }
}

}  // namespace

TimeRelation relate(const CanFindings& can, const CaptureFindings& capture) {
  TimeRelation result;
  result.start_offset_s = (can.first - capture.first).seconds();
  const double overlap_s = (std::min(can.last, capture.last) - std::max(can.first, capture.first)).seconds();
  result.overlap_s = std::max(overlap_s, 0.0);
  result.apart_s = std::max(-overlap_s, 0.0);
  return result;
}

bool RecordingFindings::usable() const {
  return std::any_of(captures.begin(), captures.end(), [](const CaptureFindings& c) { return c.usable(); }) ||
         std::any_of(bags.begin(), bags.end(), [](const BagFindings& b) { return b.usable(); }) ||
         std::any_of(can_logs.begin(), can_logs.end(), [](const CanFindings& c) { return c.usable(); });
}

RecordingFindings inspect_recording(const std::vector<std::string>& paths, const drivers::DbcDatabase* dbc) {
  RecordingFindings findings;
  for (const std::string& path : paths) {
    std::error_code code;
    const fs::file_status status = fs::status(path, code);
    if (!fs::exists(status)) {
      findings.problems.push_back(path + ": no such file or folder - check the path");
    } else if (fs::is_directory(status)) {
      inspect_folder(path, dbc, findings);
    } else {
      inspect_file(path, true, dbc, findings);
    }
  }
  return findings;
}

core::Result<BagFindings> inspect_bag(const std::vector<std::string>& files) {
  constexpr core::Duration kWhole{std::numeric_limits<std::int64_t>::max() / 4};
  auto survey = drivers::survey_bag(files, kWhole);
  if (!survey) return survey.error();
  BagFindings bag;
  bag.files = files;
  bag.survey = std::move(survey).value();
  for (const drivers::BagContent content : {drivers::BagContent::kFix, drivers::BagContent::kSentence}) {
    for (const drivers::BagTopicSurvey* const topic : bag.survey.with(content)) {
      const std::string& name = topic->topic.name;
      const auto track = gnss::read_bag_track(files, name);
      bag.gnss.push_back(track ? "GNSS " + name + ": " + gnss::summary(*track) : track.error().message);
    }
  }
  const auto input = daemon::open_bag_replay(files, daemon::Config{});
  if (!input) {
    bag.problem = input.error().message;
    return bag;
  }
  bag.notes = input->notes;
  bag.warnings = input->warnings;
  return bag;
}

std::string bag_report(const BagFindings& bag) {
  std::string text = bag.files.front();
  if (bag.files.size() > 1) text += " and " + std::to_string(bag.files.size() - 1) + " more parts";
  core::Time first{std::numeric_limits<std::int64_t>::max()};
  core::Time last{};
  std::uint64_t messages = 0;
  for (const drivers::BagTopicSurvey& topic : bag.survey.topics) {
    if (topic.messages == 0) continue;
    first = std::min(first, topic.first);
    last = std::max(last, topic.last);
    messages += topic.messages;
  }
  text += format(": ROS bag, %llu messages", static_cast<unsigned long long>(messages));
  if (messages > 0) text += format(" in %.1f s", (last - first).seconds());
  if (!bag.survey.is_complete) text += ", of which the first GiB was read";
  text += '\n' + daemon::list_topics(bag.survey);
  for (const std::string& line : bag.gnss) text += "  " + printable_text(line) + '\n';
  for (const std::string& note : bag.notes) text += "  " + note + '\n';
  for (const std::string& warning : bag.warnings) text += "  warning: " + warning + '\n';
  return text;
}

}  // namespace nilio::tools::inspect
