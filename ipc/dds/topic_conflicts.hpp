#pragma once

#include <map>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/rtps/common/Guid.h>

namespace nilio::dds {

/// Finds other programs that publish what this one publishes: a writer of the same odometry topic, or another
/// nilio that publishes the transform of the same frame. Subscribers would receive both mixed. Fast DDS's
/// threads call it; it neither logs nor calls Fast DDS.
class TopicConflicts : public eprosima::fastdds::dds::DomainParticipantListener {
 public:
  /// An empty `transform_topic`: no transform is published.
  TopicConflicts(std::string odometry_topic, std::string transform_topic, std::string base_frame);

  /// User data of a transform writer, by which another nilio finds the frame.
  static std::string user_data(const std::string& base_frame);
  /// Lines for the log about writers found since the last call. Any thread.
  std::vector<std::string> take();

  void on_participant_discovery(eprosima::fastdds::dds::DomainParticipant* participant,
                                eprosima::fastrtps::rtps::ParticipantDiscoveryInfo&& info) override;
  void on_publisher_discovery(eprosima::fastdds::dds::DomainParticipant* participant,
                              eprosima::fastrtps::rtps::WriterDiscoveryInfo&& info) override;

 private:
  [[nodiscard]] std::string find_conflict(const eprosima::fastrtps::rtps::WriterProxyData& writer) const;

  const std::string odometry_topic_;
  const std::string transform_topic_;
  const std::string base_frame_;
  std::mutex mutex_;
  /// Name and address of the others' participants, for the message.
  std::map<eprosima::fastrtps::rtps::GuidPrefix_t, std::string> participants_;
  std::set<eprosima::fastrtps::rtps::GUID_t> reported_;
  std::vector<std::string> lines_;
};

}  // namespace nilio::dds
