#include "ipc/dds/cloud_publisher.hpp"

#include "nilio/core/se3.hpp"

#include "ipc/dds/types.hpp"
#include "ipc/dds/writers.hpp"

#include <algorithm>
#include <cstring>
#include <utility>

#include <Eigen/Geometry>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

constexpr int kScanDepth = 2;
// Every sample is the whole path.
constexpr int kPathDepth = 1;
// Sent on demand.

}  // namespace

void set_fields(PointCloud2& cloud, std::initializer_list<const char*> names) {
  cloud.fields.clear();
  for (const char* const name : names)
    cloud.fields.push_back(
        {name, static_cast<std::uint32_t>(sizeof(float) * cloud.fields.size()), PointField::kFloat32, 1});
  cloud.point_step = static_cast<std::uint32_t>(sizeof(float) * cloud.fields.size());
}

void fill_cloud(const ipc::ScanCloud& scan, std::size_t max_points, PointCloud2& cloud) {
  const std::size_t count = std::min<std::size_t>({scan.count, scan.points.size(), max_points});
  cloud.stamp = {scan.stamp_ns};
  cloud.width = static_cast<std::uint32_t>(count);
  cloud.row_step = cloud.point_step * cloud.width;
  cloud.data.resize(cloud.row_step);
  const Eigen::Matrix3d R_odom_base = core::from_xyzw(scan.orientation_xyzw).toRotationMatrix();
  const Eigen::Vector3d t_odom_base(scan.position.data());
  std::uint8_t* target = cloud.data.data();
  for (std::size_t i = 0; i < count; ++i) {
    const ipc::CloudPoint& point = scan.points[i];
    const Eigen::Vector3d p = R_odom_base * Eigen::Vector3d(point.x, point.y, point.z) + t_odom_base;
    const ipc::CloudPoint in_odom{static_cast<float>(p.x()), static_cast<float>(p.y()),
                                  static_cast<float>(p.z()), point.intensity};
    std::memcpy(target, &in_odom, sizeof in_odom);
    target += sizeof in_odom;
  }
}

struct CloudPublisher::Entities {
  std::unique_ptr<Participant> participant;
  fastdds::DataWriter* scan_writer = nullptr;
  fastdds::DataWriter* path_writer = nullptr;
  PointCloud2 cloud;  // refilled for every scan; frame and fields stay
  std::string odom_frame;
};

CloudPublisher::CloudPublisher(std::unique_ptr<Entities> entities) : entities_(std::move(entities)) {}
CloudPublisher::~CloudPublisher() = default;
Participant& CloudPublisher::participant() { return *entities_->participant; }

core::Result<std::unique_ptr<CloudPublisher>> CloudPublisher::create(const CloudPublisherConfig& config) {
  auto group = create_writer_group(config.participant, config.topic_prefix);
  if (!group) return group.error();
  const TopicNames& names = group->names;
  fastdds::DomainParticipant& participant = group->participant->get();
  fastdds::Publisher& publisher = *group->publisher;
  auto entities = std::make_unique<Entities>();
  entities->scan_writer =
      create_writer<PointCloud2>(participant, publisher, names.registered_scan,
                                 {.depth = kScanDepth, .deadline = kNoDeadline, .user_data = ""});
  entities->path_writer = create_writer<Path>(
      participant, publisher, names.path, {.depth = kPathDepth, .deadline = kNoDeadline, .user_data = ""});
  if (entities->scan_writer == nullptr || entities->path_writer == nullptr)
    return core::Error{"Fast DDS cannot create the writers for " + names.registered_scan + ", " + names.path +
                       " (out of memory or sockets?)"};
  entities->odom_frame = config.odom_frame;
  entities->cloud.frame_id = config.odom_frame;
  set_fields(entities->cloud, {"x", "y", "z", "intensity"});
  entities->participant = std::move(group->participant);
  return std::unique_ptr<CloudPublisher>(new CloudPublisher(std::move(entities)));
}

bool CloudPublisher::publish_scan(const ipc::ScanCloud& scan, std::size_t max_points) {
  fill_cloud(scan, max_points, entities_->cloud);
  return entities_->scan_writer->write(&entities_->cloud);
}

bool CloudPublisher::publish_path(Path& path) {
  path.frame_id = entities_->odom_frame;
  for (PoseStamped& pose : path.poses) pose.frame_id = entities_->odom_frame;
  return entities_->path_writer->write(&path);
}

int CloudPublisher::scan_subscribers() const { return matched_subscribers(*entities_->scan_writer); }
int CloudPublisher::path_subscribers() const { return matched_subscribers(*entities_->path_writer); }

}  // namespace nilio::dds
