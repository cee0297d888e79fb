#include "nilio/drivers/bag/sources.hpp"

#include "drivers/bag/wire.hpp"

#include <algorithm>
#include <deque>
#include <map>
#include <set>

namespace nilio::drivers {

namespace {

constexpr std::uint64_t kMaxSurveyBytes = std::uint64_t{1} << 30U;

bool has_header(const BagTopicSurvey& topic) {
  const bool known = topic.content == BagContent::kCloud || topic.content == BagContent::kImu ||
                     topic.content == BagContent::kCanFrame || topic.content == BagContent::kFix ||
                     topic.content == BagContent::kSentence || topic.content == BagContent::kPackets ||
                     topic.content == BagContent::kPose;
  return known && topic.topic.type != "velodyne_msgs/VelodynePacket" &&
         !topic.topic.type.ends_with("/PacketMsg");
}

void add_header(const BagMessage& message, BagTopicSurvey& topic) {
  bag::WireReader wire(message.data, topic.topic.encoding);
  if (topic.topic.encoding == BagEncoding::kRos1) wire.number<std::uint32_t>();
  const core::Time stamp = wire.time();
  std::string_view frame = wire.text();
  if (!wire.ok() || stamp.ns <= 0) return;
  while (frame.starts_with('/')) frame.remove_prefix(1);
  if (topic.frame_id.empty()) topic.frame_id.assign(frame.substr(0, 256));
  const core::Duration delay = message.stamp - stamp;
  topic.smallest_delay = topic.smallest_delay ? std::min(*topic.smallest_delay, delay) : delay;
}

}  // namespace

double BagTopicSurvey::rate_hz() const {
  const double span_s = (last - first).seconds();
  return messages > 1 && span_s > 0.0 ? static_cast<double>(messages - 1) / span_s : 0.0;
}

std::vector<const BagTopicSurvey*> BagSurvey::with(BagContent content) const {
  std::vector<const BagTopicSurvey*> found;
  for (const BagTopicSurvey& topic : topics) {
    if (topic.content == content && topic.messages > 0) found.push_back(&topic);
  }
  return found;
}

core::Result<BagSurvey> survey_bag(const std::vector<std::string>& files, core::Duration limit) {
  auto reader = open_bag(files);
  if (!reader) return reader.error();
  BagSurvey survey;
  std::optional<core::Time> end;
  std::optional<BagMessage> message = (*reader)->next();
  for (; message; message = (*reader)->next()) {
    const std::vector<BagTopic>& topics = (*reader)->topics();
    while (survey.topics.size() < topics.size()) {
      BagTopicSurvey topic;
      topic.topic = topics[survey.topics.size()];
      topic.content = content_of(topic.topic);
      survey.topics.push_back(std::move(topic));
    }
    BagTopicSurvey& topic = survey.topics[message->topic];
    if (topic.messages++ == 0) topic.first = message->stamp;
    topic.last = std::max(topic.last, message->stamp);
    survey.bytes += message->data.size();
    if (has_header(topic)) add_header(*message, topic);
    if (topic.content == BagContent::kTransforms && topic.topic.name.ends_with("tf_static"))
      decode_transforms(topic.topic, *message, survey.static_transforms);
    if (!end) end = message->stamp + limit;
    if (message->stamp > *end || survey.bytes > kMaxSurveyBytes || survey.static_transforms.size() > 100'000)
      break;
  }
  survey.is_complete = !message;
  survey.notes = (*reader)->notes();
  return survey;
}

std::optional<core::SE3> find_transform(const std::vector<BagTransform>& transforms,
                                        const std::string& parent, const std::string& child) {
  // Breadth first: a transform may be stated once for each part of the recording.
  std::map<std::string, core::SE3> T_parent_of;
  T_parent_of[parent] = core::SE3{};
  std::deque<std::string> open{parent};
  while (!open.empty()) {
    const std::string frame = open.front();
    open.pop_front();
    if (frame == child) return T_parent_of[frame];
    for (const BagTransform& transform : transforms) {
      if (transform.parent == frame && !T_parent_of.contains(transform.child)) {
        T_parent_of[transform.child] = T_parent_of[frame] * transform.T_parent_child;
        open.push_back(transform.child);
      }
      if (transform.child == frame && !T_parent_of.contains(transform.parent)) {
        T_parent_of[transform.parent] = T_parent_of[frame] * transform.T_parent_child.inverse();
        open.push_back(transform.parent);
      }
    }
  }
  return std::nullopt;
}

}  // namespace nilio::drivers
