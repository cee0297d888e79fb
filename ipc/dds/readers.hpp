#pragma once

#include <string>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

namespace nilio::dds {

struct ReaderOptions {
  /// Received samples that wait for their listener.
  int depth = 1;
  bool reliable = true;
};

/// Creates a reader that tells `listener`, which outlives it, of samples written from now on. Takes ownership
/// of `type`. Null if Fast DDS refuses.
eprosima::fastdds::dds::DataReader* create_reader(eprosima::fastdds::dds::DomainParticipant& participant,
                                                  eprosima::fastdds::dds::Subscriber& subscriber,
                                                  const std::string& topic_name,
                                                  eprosima::fastdds::dds::TopicDataType* type,
                                                  eprosima::fastdds::dds::DataReaderListener& listener,
                                                  const ReaderOptions& options);

}  // namespace nilio::dds
