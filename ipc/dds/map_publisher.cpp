#include "ipc/dds/map_publisher.hpp"

#include "ipc/dds/cloud_publisher.hpp"
#include "ipc/dds/types.hpp"
#include "ipc/dds/writers.hpp"

#include <cstring>
#include <utility>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

// Sent when there is something new.
constexpr core::Duration kNoDeadline{0};

}  // namespace

struct MapPublisher::Entities {
  std::unique_ptr<Participant> participant;
  fastdds::DataWriter* submap_writer = nullptr;
  fastdds::DataWriter* pose_writer = nullptr;
  fastdds::DataWriter* local_map_writer = nullptr;
  fastdds::DataWriter* transform_writer = nullptr;
  std::string map_frame;
  PointCloud2 cloud;  // refilled; frame and fields stay

  bool write(fastdds::DataWriter& writer, core::Time stamp, std::span<const SurfacePoint> points);
};

MapPublisher::MapPublisher(std::unique_ptr<Entities> entities) : entities_(std::move(entities)) {}
MapPublisher::~MapPublisher() = default;
Participant& MapPublisher::participant() { return *entities_->participant; }

core::Result<std::unique_ptr<MapPublisher>> MapPublisher::create(const MapPublisherConfig& config) {
  auto group = create_writer_group(config.participant, config.topic_prefix);
  if (!group) return group.error();
  const TopicNames& names = group->names;
  fastdds::DomainParticipant& participant = group->participant->get();
  fastdds::Publisher& publisher = *group->publisher;
  auto entities = std::make_unique<Entities>();
  const WriterOptions kept{
      .depth = config.kept_submaps, .deadline = kNoDeadline, .transient_local = true, .user_data = ""};
  const WriterOptions latest{.depth = 1, .deadline = kNoDeadline, .transient_local = true, .user_data = ""};
  entities->submap_writer = create_writer<PointCloud2>(participant, publisher, names.submaps, kept);
  entities->pose_writer = create_writer<Path>(participant, publisher, names.submap_poses, latest);
  entities->local_map_writer = create_writer<PointCloud2>(
      participant, publisher, names.local_map, {.depth = 1, .deadline = kNoDeadline, .user_data = ""});
  entities->transform_writer =
      create_writer<TransformMessage>(participant, publisher, names.static_transform, latest);
  if (entities->submap_writer == nullptr || entities->pose_writer == nullptr ||
      entities->local_map_writer == nullptr || entities->transform_writer == nullptr)
    return core::Error{"Fast DDS cannot create the writers of the map (out of memory or sockets?)"};
  entities->map_frame = config.map_frame;
  entities->cloud.frame_id = config.map_frame;
  set_fields(entities->cloud, {"x", "y", "z", "intensity", "normal_x", "normal_y", "normal_z", "curvature"});
  TransformMessage transform;
  transform.transforms.push_back({{}, config.map_frame, config.odom_frame, {}, {0.0, 0.0, 0.0, 1.0}});
  if (!entities->transform_writer->write(&transform))
    return core::Error{"Fast DDS cannot write the transform from " + config.map_frame + " to " +
                       config.odom_frame};
  entities->participant = std::move(group->participant);
  return std::unique_ptr<MapPublisher>(new MapPublisher(std::move(entities)));
}

bool MapPublisher::Entities::write(fastdds::DataWriter& writer, core::Time stamp,
                                   std::span<const SurfacePoint> points) {
  cloud.stamp = stamp;
  cloud.width = static_cast<std::uint32_t>(points.size());
  cloud.row_step = cloud.point_step * cloud.width;
  cloud.data.resize(points.size_bytes());
  if (!points.empty()) std::memcpy(cloud.data.data(), points.data(), points.size_bytes());
  return writer.write(&cloud);
}

bool MapPublisher::publish_submap(core::Time stamp, std::span<const SurfacePoint> points) {
  return entities_->write(*entities_->submap_writer, stamp, points);
}

bool MapPublisher::publish_local_map(core::Time stamp, std::span<const SurfacePoint> points) {
  return entities_->write(*entities_->local_map_writer, stamp, points);
}

bool MapPublisher::publish_poses(Path& poses) {
  poses.frame_id = entities_->map_frame;
  for (PoseStamped& pose : poses.poses) pose.frame_id = entities_->map_frame;
  return entities_->pose_writer->write(&poses);
}

int MapPublisher::local_map_subscribers() const { return matched_subscribers(*entities_->local_map_writer); }

}  // namespace nilio::dds
