#pragma once

#include <string>
#include <string_view>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

namespace nilio::dds {

// Type hashes that ROS 2 (Iron and later) publishes for these message definitions (REP 2011).
inline constexpr std::string_view kOdometryHash =
    "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
inline constexpr std::string_view kTransformHash =
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";

struct WriterOptions {
  int depth = 10;
  bool reliable = true;
  std::string_view type_hash;  ///< empty: no ROS type
};

/// Creates a volatile writer that keeps the last `depth` samples and sends from the writing thread. Takes
/// ownership of `type`. Null if Fast DDS refuses.
eprosima::fastdds::dds::DataWriter* create_writer(eprosima::fastdds::dds::DomainParticipant& participant,
                                                  eprosima::fastdds::dds::Publisher& publisher,
                                                  const std::string& topic_name,
                                                  eprosima::fastdds::dds::TopicDataType* type,
                                                  const WriterOptions& options);

/// Number of matched subscribers of the writer.
int matched_subscribers(const eprosima::fastdds::dds::DataWriter& writer);

}  // namespace nilio::dds
