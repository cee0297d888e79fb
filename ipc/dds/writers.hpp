#pragma once

#include <string>
#include <string_view>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

namespace nilio::dds {

// The type hashes that ROS 2 (Iron and later) publishes for these message definitions (REP 2011).
inline constexpr std::string_view kOdometryHash =
    "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
inline constexpr std::string_view kTransformHash =
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";

struct WriterOptions {
  int depth = 10;
  bool reliable = true;
  std::string_view type_hash;  ///< empty: not a type of ROS
};

/// A volatile writer that keeps the last `depth` samples and sends from the thread that writes. Takes `type`
/// over. Null when Fast DDS refuses.
eprosima::fastdds::dds::DataWriter* create_writer(eprosima::fastdds::dds::DomainParticipant& participant,
                                                  eprosima::fastdds::dds::Publisher& publisher,
                                                  const std::string& topic_name,
                                                  eprosima::fastdds::dds::TopicDataType* type,
                                                  const WriterOptions& options);

/// Subscribers that the writer has found.
int matched_subscribers(const eprosima::fastdds::dds::DataWriter& writer);

}  // namespace nilio::dds
