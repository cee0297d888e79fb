#pragma once

#include "ipc/messages/messages.hpp"

#include <cstdint>
#include <functional>
#include <string_view>

#include <fastdds/dds/topic/TopicDataType.hpp>

namespace nilio::dds {

/// Serialization of a message: plain CDR (XCDR version 1) according to ipc/idl/nilio.idl, written by hand so
/// that no generator is needed at build time. deserialize() accepts any bytes from the network: it returns
/// false rather than throw or allocate more than the bytes could fill.
template <class Message>
class MessageType : public eprosima::fastdds::dds::TopicDataType {
 public:
  using Payload = eprosima::fastrtps::rtps::SerializedPayload_t;

  /// Registers under the DDS name of the ROS 2 type.
  MessageType();
  /// Hash by which ROS 2 (Iron and later) compares message definitions (REP 2011).
  static std::string_view type_hash();

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
extern template class MessageType<PointCloud2>;
extern template class MessageType<Path>;

using OdometryType = MessageType<Odometry>;
using TransformType = MessageType<TransformMessage>;
using LatencyReportType = MessageType<LatencyReport>;
using DiagnosticArrayType = MessageType<DiagnosticArray>;
using ScanReportType = MessageType<ScanReport>;
using ImuPoseStatusType = MessageType<ImuPoseStatus>;
using PointCloud2Type = MessageType<PointCloud2>;
using PathType = MessageType<Path>;

}  // namespace nilio::dds
