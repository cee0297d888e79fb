#include "tools/inspect/bag.hpp"

#include "daemon/input/bag_input.hpp"
#include "tools/common/text.hpp"
#include "tools/gnss/track.hpp"

#include <algorithm>
#include <limits>

namespace nilio::tools::inspect {

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
