#include "ipc/dds/writers.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <cstdint>
#include <utility>

#include <fastdds/dds/topic/TypeSupport.hpp>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

fastdds::DataWriterQos writer_qos(std::string_view type_hash, const WriterOptions& options) {
  fastdds::DataWriterQos qos;
  qos.reliability().kind =
      options.reliable ? fastdds::RELIABLE_RELIABILITY_QOS : fastdds::BEST_EFFORT_RELIABILITY_QOS;
  // Maximum wait of a write for Fast DDS's other threads; the default is 100 ms.
  qos.reliability().max_blocking_time = eprosima::fastrtps::Duration_t(0, 20'000'000);
  qos.durability().kind =
      options.transient_local ? fastdds::TRANSIENT_LOCAL_DURABILITY_QOS : fastdds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = fastdds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = options.depth;
  qos.publish_mode().kind = fastdds::SYNCHRONOUS_PUBLISH_MODE;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();
  // A lost pose is requested again within one scan period; the default is 3 s.
  qos.reliable_writer_qos().times.heartbeatPeriod = eprosima::fastrtps::Duration_t(0, 100'000'000);
  if (options.deadline.ns > 0) qos.deadline().period = dds_duration(options.deadline);
  qos.liveliness().kind = fastdds::AUTOMATIC_LIVELINESS_QOS;
  qos.liveliness().lease_duration = dds_duration(kLivelinessLease);
  qos.liveliness().announcement_period = dds_duration(core::Duration{kLivelinessLease.ns / 4});
  const std::string user_data = "typehash=" + std::string(type_hash) + ";" + options.user_data;
  qos.user_data().data_vec({user_data.begin(), user_data.end()});
  return qos;
}

}  // namespace

core::Result<WriterGroup> create_writer_group(const ParticipantConfig& config,
                                              const std::string& topic_prefix) {
  auto names = topic_names(topic_prefix);
  if (!names) return names.error();
  auto participant = Participant::create(config);
  if (!participant) return participant.error();
  WriterGroup group{std::move(names).value(), std::move(participant).value()};
  group.publisher = group.participant->get().create_publisher(fastdds::PUBLISHER_QOS_DEFAULT);
  if (group.publisher == nullptr) return core::Error{"Fast DDS cannot create a publisher (out of memory?)"};
  return group;
}

eprosima::fastrtps::Duration_t dds_duration(core::Duration duration) {
  const std::int64_t ns = std::max<std::int64_t>(duration.ns, 0);
  return {static_cast<std::int32_t>(ns / kNanosecondsPerSecond),
          static_cast<std::uint32_t>(ns % kNanosecondsPerSecond)};
}

fastdds::DataWriter* create_writer(fastdds::DomainParticipant& participant, fastdds::Publisher& publisher,
                                   const std::string& topic_name, fastdds::TopicDataType* type,
                                   std::string_view type_hash, const WriterOptions& options) {
  const fastdds::TypeSupport own(type);
  // Several topics may have the same type.
  const fastdds::TypeSupport known = participant.find_type(own.get_type_name());
  const fastdds::TypeSupport& support = known.empty() ? own : known;
  if (known.empty() && own.register_type(&participant) != ReturnCode_t::RETCODE_OK) return nullptr;
  fastdds::Topic* const topic =
      participant.create_topic(topic_name, support.get_type_name(), fastdds::TOPIC_QOS_DEFAULT);
  if (topic == nullptr) return nullptr;
  return publisher.create_datawriter(topic, writer_qos(type_hash, options));
}

int matched_subscribers(const fastdds::DataWriter& writer) {
  fastdds::PublicationMatchedStatus status;
  if (writer.get_publication_matched_status(status) != ReturnCode_t::RETCODE_OK) return 0;
  return status.current_count;
}

}  // namespace nilio::dds
