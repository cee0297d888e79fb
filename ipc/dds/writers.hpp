#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/dds/participant.hpp"
#include "ipc/dds/types.hpp"

#include <memory>
#include <string>
#include <string_view>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>

namespace nilio::dds {

/// Of a writer that promises none.
inline constexpr core::Duration kNoDeadline{0};

struct WriterOptions {
  int depth = 10;
  bool reliable = true;
  /// Promised maximum time between two samples; a reader that requests no shorter one is told when it is
  /// exceeded.
  core::Duration deadline{500'000'000};
  /// Late readers receive the last `depth` samples.
  bool transient_local = false;
  /// `key=value;` pairs of the writer's user data, beside the type hash.
  std::string user_data;
};

/// Writers that share a participant and its publisher; the names of all topics.
struct WriterGroup {
  TopicNames names;
  std::unique_ptr<Participant> participant;
  eprosima::fastdds::dds::Publisher* publisher = nullptr;
};
core::Result<WriterGroup> create_writer_group(const ParticipantConfig& config,
                                              const std::string& topic_prefix);

/// Time after which readers are told that a writer's process has ended or hangs.
inline constexpr core::Duration kLivelinessLease{2'000'000'000};

/// Creates a writer that keeps the last `depth` samples and sends from the writing thread. Deadline
/// and liveliness are finite, which matches readers with ROS 2's defaults and readers that request as much.
/// Takes ownership of `type`. Null if Fast DDS refuses.
eprosima::fastdds::dds::DataWriter* create_writer(eprosima::fastdds::dds::DomainParticipant& participant,
                                                  eprosima::fastdds::dds::Publisher& publisher,
                                                  const std::string& topic_name,
                                                  eprosima::fastdds::dds::TopicDataType* type,
                                                  std::string_view type_hash, const WriterOptions& options);

template <class Message>
eprosima::fastdds::dds::DataWriter* create_writer(eprosima::fastdds::dds::DomainParticipant& participant,
                                                  eprosima::fastdds::dds::Publisher& publisher,
                                                  const std::string& topic_name,
                                                  const WriterOptions& options) {
  return create_writer(participant, publisher, topic_name, new MessageType<Message>,
                       MessageType<Message>::type_hash(), options);
}

/// Negative durations become 0.
eprosima::fastrtps::Duration_t dds_duration(core::Duration duration);

/// Number of matched subscribers of the writer.
int matched_subscribers(const eprosima::fastdds::dds::DataWriter& writer);

}  // namespace nilio::dds
