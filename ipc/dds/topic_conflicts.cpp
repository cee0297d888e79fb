#include "ipc/dds/topic_conflicts.hpp"

#include <cstddef>
#include <sstream>
#include <utility>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/rtps/builtin/data/ParticipantProxyData.h>
#include <fastdds/rtps/builtin/data/WriterProxyData.h>
#include <fastdds/rtps/participant/ParticipantDiscoveryInfo.h>
#include <fastdds/rtps/writer/WriterDiscoveryInfo.h>
#include <fastrtps/utils/IPLocator.h>

namespace nilio::dds {
namespace {

namespace rtps = eprosima::fastrtps::rtps;

// Limit of the remembered participants and writers: anybody can announce anything.
constexpr std::size_t kMaxRemembered = 256;

// Name and address of a participant, without characters that would garble the log.
std::string describe(const rtps::ParticipantProxyData& participant) {
  std::string name;
  for (const char c : participant.m_participantName.to_string()) name += c >= ' ' && c <= '~' ? c : '?';
  std::string text = '"' + name + '"';
  for (const rtps::Locator_t& locator : participant.default_locators.unicast) {
    if (rtps::IPLocator::isLocal(locator)) continue;
    return text + " at " + rtps::IPLocator::toIPv4string(locator);
  }
  return text + " on this machine";
}

}  // namespace

TopicConflicts::TopicConflicts(std::string odometry_topic, std::string transform_topic,
                               std::string base_frame)
    : odometry_topic_(std::move(odometry_topic)),
      transform_topic_(std::move(transform_topic)),
      base_frame_(std::move(base_frame)) {}

std::string TopicConflicts::user_data(const std::string& base_frame) {
  return "child_frame=" + base_frame + ";";
}

std::vector<std::string> TopicConflicts::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(lines_, {});
}

void TopicConflicts::on_participant_discovery(eprosima::fastdds::dds::DomainParticipant*,
                                              rtps::ParticipantDiscoveryInfo&& info) {
  const rtps::GuidPrefix_t& prefix = info.info.m_guid.guidPrefix;
  const std::lock_guard lock(mutex_);
  if (info.status == rtps::ParticipantDiscoveryInfo::DISCOVERED_PARTICIPANT) {
    if (participants_.size() < kMaxRemembered) participants_[prefix] = describe(info.info);
  } else if (info.status != rtps::ParticipantDiscoveryInfo::CHANGED_QOS_PARTICIPANT) {
    participants_.erase(prefix);
  }
}

void TopicConflicts::on_publisher_discovery(eprosima::fastdds::dds::DomainParticipant* participant,
                                            rtps::WriterDiscoveryInfo&& info) {
  if (info.status != rtps::WriterDiscoveryInfo::DISCOVERED_WRITER) return;
  const rtps::GUID_t& guid = info.info.guid();
  if (participant == nullptr || guid.guidPrefix == participant->guid().guidPrefix) return;
  const std::string conflict = find_conflict(info.info);
  if (conflict.empty()) return;
  const std::lock_guard lock(mutex_);
  if (reported_.size() >= kMaxRemembered || !reported_.insert(guid).second) return;
  const auto other = participants_.find(guid.guidPrefix);
  std::ostringstream line;
  line << conflict << (other != participants_.end() ? other->second : "another program") << " (GUID " << guid
       << ") - stop one of them, or give it another publisher.domain, or another publisher.topic_prefix and "
          "publisher.base_frame";
  lines_.push_back(line.str());
}

// Begin of the message, or empty.
std::string TopicConflicts::find_conflict(const rtps::WriterProxyData& writer) const {
  const std::string topic = writer.topicName().to_string();
  if (topic == odometry_topic_) return topic + ": poses are also published by ";
  if (transform_topic_.empty() || topic != transform_topic_) return {};
  const auto& bytes = writer.m_qos.m_userData.getValue();
  const std::string data(bytes.begin(), bytes.end());
  if (data.find(";" + user_data(base_frame_)) == std::string::npos) return {};
  return topic + ": the transform of " + base_frame_ + " is also published by ";
}

}  // namespace nilio::dds
