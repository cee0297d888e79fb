#include "ipc/dds/imu_pose_publisher.hpp"

#include "ipc/dds/types.hpp"
#include "ipc/dds/writers.hpp"

#include <utility>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

std::array<double, 3> array_of(const core::Vector3& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

void fill_odometry(const ipc::ImuPose& pose, Odometry& odometry) {
  odometry.stamp = pose.stamp;
  odometry.position = array_of(pose.T_odom_base.translation);
  odometry.orientation_xyzw = core::xyzw(pose.T_odom_base.rotation);
  odometry.pose_covariance = pose.pose_covariance;
  odometry.linear_velocity = array_of(pose.linear_velocity);
  odometry.angular_velocity = array_of(pose.angular_velocity);
  odometry.twist_covariance = pose.twist_covariance;
}

struct ImuPosePublisher::Entities {
  fastdds::DataWriter* pose_writer = nullptr;
  fastdds::DataWriter* status_writer = nullptr;
  Odometry odometry;  // refilled for every pose; the frame names stay
};

ImuPosePublisher::ImuPosePublisher(std::unique_ptr<Entities> entities) : entities_(std::move(entities)) {}
ImuPosePublisher::~ImuPosePublisher() = default;

core::Result<std::unique_ptr<ImuPosePublisher>> ImuPosePublisher::create(
    OdometryPublisher& publisher, const OdometryPublisherConfig& config) {
  auto names = topic_names(config.topic_prefix);
  if (!names) return names.error();
  fastdds::DomainParticipant& participant = publisher.participant().get();
  // A separate publisher: waiting for acknowledgements of the other's writers holds their lock.
  fastdds::Publisher* const own = participant.create_publisher(fastdds::PUBLISHER_QOS_DEFAULT);
  if (own == nullptr) return core::Error{"Fast DDS cannot create a second publisher (out of memory?)"};
  auto entities = std::make_unique<Entities>();
  entities->pose_writer = create_writer<Odometry>(
      participant, *own, names->imu_odometry, {.depth = kHistoryDepth, .reliable = false, .user_data = ""});
  entities->status_writer = create_writer<ImuPoseStatus>(
      participant, *own, names->imu_status, {.depth = OdometryPublisher::kHistoryDepth, .user_data = ""});
  if (entities->pose_writer == nullptr || entities->status_writer == nullptr)
    return core::Error{"Fast DDS cannot create the writers for " + names->imu_odometry + ", " +
                       names->imu_status + " (out of memory or sockets?)"};
  entities->odometry.frame_id = config.odom_frame;
  entities->odometry.child_frame_id = config.base_frame;
  return std::unique_ptr<ImuPosePublisher>(new ImuPosePublisher(std::move(entities)));
}

bool ImuPosePublisher::publish(const ipc::ImuPose& pose) {
  fill_odometry(pose, entities_->odometry);
  return entities_->pose_writer->write(&entities_->odometry);
}

bool ImuPosePublisher::publish_status(const ImuPoseStatus& status) {
  ImuPoseStatus copy = status;  // write() takes a pointer to non-const
  return entities_->status_writer->write(&copy);
}

int ImuPosePublisher::subscribers() const { return matched_subscribers(*entities_->pose_writer); }

}  // namespace nilio::dds
