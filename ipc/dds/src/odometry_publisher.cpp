#include "nilio/dds/odometry_publisher.hpp"

#include "nilio/dds/types.hpp"

#include <algorithm>
#include <string_view>
#include <utility>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

constexpr int kTransformDepth = 100;  // ROS's QoS for /tf

// The type hashes that ROS 2 (Iron and later) publishes for these message definitions (REP 2011).
constexpr std::string_view kOdometryHash =
    "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0";
constexpr std::string_view kTransformHash =
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087";

fastdds::DataWriterQos writer_qos(int depth, std::string_view type_hash) {
  fastdds::DataWriterQos qos;
  qos.reliability().kind = fastdds::RELIABLE_RELIABILITY_QOS;
  qos.durability().kind = fastdds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = fastdds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = depth;
  qos.publish_mode().kind = fastdds::SYNCHRONOUS_PUBLISH_MODE;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.data_sharing().off();
  // A lost pose is asked for again within one scan period; the default is 3 s.
  qos.reliable_writer_qos().times.heartbeatPeriod = eprosima::fastrtps::Duration_t(0, 100'000'000);
  if (!type_hash.empty()) {
    const std::string user_data = "typehash=" + std::string(type_hash) + ";";
    qos.user_data().data_vec({user_data.begin(), user_data.end()});
  }
  return qos;
}

fastdds::DataWriter* create_writer(fastdds::DomainParticipant& participant, fastdds::Publisher& publisher,
                                   const std::string& topic_name, fastdds::TopicDataType* type, int depth,
                                   std::string_view type_hash) {
  const fastdds::TypeSupport support(type);  // owns the type
  if (support.register_type(&participant) != ReturnCode_t::RETCODE_OK) return nullptr;
  fastdds::Topic* const topic =
      participant.create_topic(topic_name, support.get_type_name(), fastdds::TOPIC_QOS_DEFAULT);
  if (topic == nullptr) return nullptr;
  return publisher.create_datawriter(topic, writer_qos(depth, type_hash));
}

int matched(const fastdds::DataWriter& writer) {
  fastdds::PublicationMatchedStatus status;
  if (writer.get_publication_matched_status(status) != ReturnCode_t::RETCODE_OK) return 0;
  return status.current_count;
}

}  // namespace

void fill_odometry(const ipc::PoseRecord& record, Odometry& odometry) {
  odometry.stamp = {record.stamp_ns};
  odometry.position = record.position;
  odometry.orientation_xyzw = record.orientation_xyzw;
  odometry.pose_covariance = record.pose_covariance;
  odometry.linear_velocity = record.linear_velocity;
  odometry.angular_velocity = record.angular_velocity;
  odometry.twist_covariance = record.twist_covariance;
}

struct OdometryPublisher::Entities {
  std::unique_ptr<Participant> participant;
  fastdds::Publisher* publisher = nullptr;
  fastdds::DataWriter* odometry_writer = nullptr;
  fastdds::DataWriter* transform_writer = nullptr;
  fastdds::DataWriter* latency_writer = nullptr;
  fastdds::DataWriter* diagnostics_writer = nullptr;
  // Filled anew for every pose; the frame names stay.
  Odometry odometry;
  TransformMessage transform;
};

OdometryPublisher::OdometryPublisher(std::unique_ptr<Entities> entities) : entities_(std::move(entities)) {}
OdometryPublisher::~OdometryPublisher() = default;
Participant& OdometryPublisher::participant() { return *entities_->participant; }

core::Result<std::unique_ptr<OdometryPublisher>> OdometryPublisher::create(
    const OdometryPublisherConfig& config) {
  if (config.odom_frame.empty() || config.base_frame.empty())
    return core::Error{"the frame names of the odometry must not be empty (usual: odom, base_link)"};
  auto names = topic_names(config.topic_prefix);
  if (!names) return names.error();
  auto participant = Participant::create(config.participant);
  if (!participant) return participant.error();

  auto entities = std::make_unique<Entities>();
  entities->participant = std::move(participant).value();
  fastdds::DomainParticipant& domain_participant = entities->participant->get();
  fastdds::Publisher* const publisher = domain_participant.create_publisher(fastdds::PUBLISHER_QOS_DEFAULT);
  if (publisher == nullptr) return core::Error{"Fast DDS cannot create a publisher (out of memory?)"};
  entities->publisher = publisher;
  entities->odometry_writer = create_writer(domain_participant, *publisher, names->odometry, new OdometryType,
                                            kHistoryDepth, kOdometryHash);
  entities->transform_writer = create_writer(domain_participant, *publisher, names->transform,
                                             new TransformType, kTransformDepth, kTransformHash);
  entities->latency_writer =
      create_writer(domain_participant, *publisher, names->latency, new LatencyReportType, kHistoryDepth, "");
  entities->diagnostics_writer = create_writer(domain_participant, *publisher, names->diagnostics,
                                               new DiagnosticArrayType, kHistoryDepth, "");
  if (entities->odometry_writer == nullptr || entities->transform_writer == nullptr ||
      entities->latency_writer == nullptr || entities->diagnostics_writer == nullptr)
    return core::Error{"Fast DDS cannot create the writers for " + names->odometry + ", " + names->transform +
                       ", " + names->latency + ", " + names->diagnostics + " (out of memory or sockets?)"};
  entities->odometry.frame_id = config.odom_frame;
  entities->odometry.child_frame_id = config.base_frame;
  TransformStamped& transform = entities->transform.transforms.emplace_back();
  transform.frame_id = config.odom_frame;
  transform.child_frame_id = config.base_frame;
  return std::unique_ptr<OdometryPublisher>(new OdometryPublisher(std::move(entities)));
}

bool OdometryPublisher::publish_odometry(const ipc::PoseRecord& record) {
  fill_odometry(record, entities_->odometry);
  return entities_->odometry_writer->write(&entities_->odometry);
}

bool OdometryPublisher::publish_transform(const ipc::PoseRecord& record) {
  TransformStamped& transform = entities_->transform.transforms.front();
  transform.stamp = {record.stamp_ns};
  transform.translation = record.position;
  transform.rotation_xyzw = record.orientation_xyzw;
  return entities_->transform_writer->write(&entities_->transform);
}

bool OdometryPublisher::publish_latency(const LatencyReport& report) {
  LatencyReport copy = report;  // write() takes a pointer to something mutable
  return entities_->latency_writer->write(&copy);
}

bool OdometryPublisher::publish_diagnostics(const DiagnosticArray& diagnostics) {
  DiagnosticArray copy = diagnostics;
  return entities_->diagnostics_writer->write(&copy);
}

int OdometryPublisher::subscribers() const {
  return std::max(matched(*entities_->odometry_writer), matched(*entities_->transform_writer));
}

bool OdometryPublisher::wait_for_acknowledgments(core::Duration timeout) {
  const eprosima::fastrtps::Duration_t limit(static_cast<std::int32_t>(timeout.ns / 1'000'000'000),
                                             static_cast<std::uint32_t>(timeout.ns % 1'000'000'000));
  return entities_->publisher->wait_for_acknowledgments(limit) == ReturnCode_t::RETCODE_OK;
}

}  // namespace nilio::dds
