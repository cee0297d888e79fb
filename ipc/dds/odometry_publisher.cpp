#include "ipc/dds/odometry_publisher.hpp"

#include "ipc/dds/topic_conflicts.hpp"
#include "ipc/dds/types.hpp"
#include "ipc/dds/writers.hpp"

#include <algorithm>
#include <chrono>
#include <utility>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

constexpr int kTransformDepth = 100;  // ROS's QoS for /tf
// Twice the period of the reports.
constexpr core::Duration kReportDeadline{2'000'000'000};

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
  fastdds::DataWriter* scan_report_writer = nullptr;
  fastdds::DataWriter* diagnostics_writer = nullptr;
  // Refilled for every pose; the frame names stay.
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
  auto participant = Participant::create(
      config.participant,
      std::make_unique<TopicConflicts>(names->odometry, config.transform ? names->transform : std::string(),
                                       config.base_frame));
  if (!participant) return participant.error();

  auto entities = std::make_unique<Entities>();
  entities->participant = std::move(participant).value();
  fastdds::DomainParticipant& domain_participant = entities->participant->get();
  fastdds::Publisher* const publisher = domain_participant.create_publisher(fastdds::PUBLISHER_QOS_DEFAULT);
  if (publisher == nullptr) return core::Error{"Fast DDS cannot create a publisher (out of memory?)"};
  entities->publisher = publisher;
  const auto create = [&]<class Message>(const Message&, const std::string& topic,
                                         const WriterOptions& options) {
    return create_writer<Message>(domain_participant, *publisher, topic, options);
  };
  const WriterOptions once_per_scan{.depth = kHistoryDepth, .user_data = ""};
  const WriterOptions once_per_second{.depth = kHistoryDepth, .deadline = kReportDeadline, .user_data = ""};
  entities->odometry_writer = create(Odometry{}, names->odometry, once_per_scan);
  if (config.transform)
    entities->transform_writer =
        create(TransformMessage{}, names->transform,
               {.depth = kTransformDepth, .user_data = TopicConflicts::user_data(config.base_frame)});
  entities->scan_report_writer = create(ScanReport{}, names->scan_report, once_per_scan);
  entities->latency_writer = create(LatencyReport{}, names->latency, once_per_second);
  entities->diagnostics_writer = create(DiagnosticArray{}, names->diagnostics, once_per_second);
  if (entities->odometry_writer == nullptr || (config.transform && entities->transform_writer == nullptr) ||
      entities->latency_writer == nullptr || entities->scan_report_writer == nullptr ||
      entities->diagnostics_writer == nullptr)
    return core::Error{"Fast DDS cannot create the writers for " + names->odometry + ", " + names->transform +
                       ", " + names->latency + ", " + names->scan_report + ", " + names->diagnostics +
                       " (out of memory or sockets?)"};
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
  if (entities_->transform_writer == nullptr) return true;
  TransformStamped& transform = entities_->transform.transforms.front();
  transform.stamp = {record.stamp_ns};
  transform.translation = record.position;
  transform.rotation_xyzw = record.orientation_xyzw;
  return entities_->transform_writer->write(&entities_->transform);
}

bool OdometryPublisher::publish_latency(LatencyReport& report) {
  return entities_->latency_writer->write(&report);
}

bool OdometryPublisher::publish_scan_report(const ScanReport& report) {
  ScanReport copy = report;  // write() takes a pointer to non-const
  return entities_->scan_report_writer->write(&copy);
}

bool OdometryPublisher::publish_diagnostics(const DiagnosticArray& diagnostics) {
  DiagnosticArray copy = diagnostics;
  return entities_->diagnostics_writer->write(&copy);
}

int OdometryPublisher::subscribers() const {
  return std::max(matched_subscribers(*entities_->odometry_writer), transform_subscribers());
}

int OdometryPublisher::transform_subscribers() const {
  const fastdds::DataWriter* transform = entities_->transform_writer;
  return transform == nullptr ? 0 : matched_subscribers(*transform);
}

bool OdometryPublisher::wait_for_pose_acknowledgments(core::Duration timeout) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::nanoseconds(timeout.ns);
  for (fastdds::DataWriter* writer :
       {entities_->odometry_writer, entities_->transform_writer, entities_->scan_report_writer}) {
    if (writer == nullptr) continue;
    const core::Duration left{std::chrono::nanoseconds(limit - std::chrono::steady_clock::now()).count()};
    if (writer->wait_for_acknowledgments(dds_duration(left)) != ReturnCode_t::RETCODE_OK) return false;
  }
  return true;
}

bool OdometryPublisher::wait_for_acknowledgments(core::Duration timeout) {
  return entities_->publisher->wait_for_acknowledgments(dds_duration(timeout)) == ReturnCode_t::RETCODE_OK;
}

}  // namespace nilio::dds
