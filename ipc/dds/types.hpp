#pragma once

#include "ipc/dds/messages.hpp"

#include <cstdint>
#include <functional>

#include <fastdds/dds/topic/TopicDataType.hpp>

namespace nilio::dds {

/// How a message lies on the wire: plain CDR (XCDR version 1), to ipc/idl/nilio.idl, hence no generator at
/// build time. deserialize() takes its bytes from the network: whatever they are, it returns false rather
/// than throw or allocate more than the bytes could fill.
template <class Message>
class MessageType : public eprosima::fastdds::dds::TopicDataType {
 public:
  using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;

  /// Registers under the name that ROS 2 gives the type in DDS.
  MessageType();

  bool serialize(void* data, Payload* payload) override;
  bool deserialize(Payload* payload, void* data) override;
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override;
  void* createData() override { return new Message; }
  void deleteData(void* data) override { delete static_cast<Message*>(data); }
  /// The types have no key.
  bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

extern template class MessageType<Odometry>;
extern template class MessageType<TransformMessage>;
extern template class MessageType<LatencyReport>;
extern template class MessageType<DiagnosticArray>;
extern template class MessageType<ScanReport>;
extern template class MessageType<ImuPoseStatus>;

using OdometryType = MessageType<Odometry>;
using TransformType = MessageType<TransformMessage>;
using LatencyReportType = MessageType<LatencyReport>;
using DiagnosticArrayType = MessageType<DiagnosticArray>;
using ScanReportType = MessageType<ScanReport>;
using ImuPoseStatusType = MessageType<ImuPoseStatus>;

}  // namespace nilio::dds
