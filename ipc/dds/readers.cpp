#include "ipc/dds/readers.hpp"

#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

namespace nilio::dds {

namespace fastdds = eprosima::fastdds::dds;

fastdds::DataReader* create_reader(fastdds::DomainParticipant& participant, fastdds::Subscriber& subscriber,
                                   const std::string& topic_name, fastdds::TopicDataType* type,
                                   fastdds::DataReaderListener& listener, const ReaderOptions& options) {
  const fastdds::TypeSupport support(type);  // owns the type
  if (support.register_type(&participant) != ReturnCode_t::RETCODE_OK) return nullptr;
  fastdds::Topic* const topic =
      participant.create_topic(topic_name, support.get_type_name(), fastdds::TOPIC_QOS_DEFAULT);
  if (topic == nullptr) return nullptr;
  fastdds::DataReaderQos qos;
  qos.reliability().kind =
      options.reliable ? fastdds::RELIABLE_RELIABILITY_QOS : fastdds::BEST_EFFORT_RELIABILITY_QOS;
  qos.durability().kind = fastdds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = fastdds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = options.depth;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();
  return subscriber.create_datareader(topic, qos, &listener);
}

}  // namespace nilio::dds
