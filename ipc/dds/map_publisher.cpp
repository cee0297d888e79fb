#include "ipc/dds/map_publisher.hpp"

#include "nilio/core/units.hpp"

#include "ipc/dds/cloud_publisher.hpp"
#include "ipc/dds/types.hpp"
#include "ipc/dds/writers.hpp"

#include <array>
#include <cstdio>
#include <cstring>
#include <utility>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

// Sent when there is something new.
constexpr int kKeptCorrections = 10;

}  // namespace

struct MapPublisher::Entities {
  std::unique_ptr<Participant> participant;
  fastdds::DataWriter* submap_writer = nullptr;
  fastdds::DataWriter* pose_writer = nullptr;
  fastdds::DataWriter* local_map_writer = nullptr;
  fastdds::DataWriter* transform_writer = nullptr;
  fastdds::DataWriter* correction_writer = nullptr;
  std::string map_frame;
  std::string odom_frame;
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
  const WriterOptions last_ones{
      .depth = kKeptCorrections, .deadline = kNoDeadline, .transient_local = true, .user_data = ""};
  const WriterOptions latest{.depth = 1, .deadline = kNoDeadline, .transient_local = true, .user_data = ""};
  entities->submap_writer = create_writer<PointCloud2>(participant, publisher, names.submaps, kept);
  entities->pose_writer = create_writer<Path>(participant, publisher, names.submap_poses, latest);
  entities->local_map_writer = create_writer<PointCloud2>(
      participant, publisher, names.local_map, {.depth = 1, .deadline = kNoDeadline, .user_data = ""});
  entities->transform_writer =
      create_writer<TransformMessage>(participant, publisher, names.static_transform, latest);
  entities->correction_writer =
      create_writer<DiagnosticArray>(participant, publisher, names.map_corrections, last_ones);
  if (entities->submap_writer == nullptr || entities->pose_writer == nullptr ||
      entities->local_map_writer == nullptr || entities->transform_writer == nullptr ||
      entities->correction_writer == nullptr)
    return core::Error{"Fast DDS cannot create the writers of the map (out of memory or sockets?)"};
  entities->map_frame = config.map_frame;
  entities->odom_frame = config.odom_frame;
  entities->cloud.frame_id = config.map_frame;
  set_fields(entities->cloud, {"x", "y", "z", "intensity", "normal_x", "normal_y", "normal_z", "curvature"});
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

bool MapPublisher::publish_transform(core::Time stamp, const core::SE3& T_map_odom) {
  const core::Vector3& t = T_map_odom.translation;
  TransformMessage message;
  message.transforms.push_back({stamp,
                                entities_->map_frame,
                                entities_->odom_frame,
                                {t.x(), t.y(), t.z()},
                                core::xyzw(T_map_odom.rotation)});
  return entities_->transform_writer->write(&message);
}

bool MapPublisher::publish_correction(const MapCorrectionReport& report) {
  const auto text = [](double value) {
    std::array<char, 32> digits{};
    std::snprintf(digits.data(), digits.size(), "%.4f", value);
    return std::string(digits.data());
  };
  DiagnosticStatus status;
  status.name = "nilio: map to odom";
  status.message = report.cause;
  status.values = {{"loops", std::to_string(report.loops)},
                   {"distance_m", text(report.distance_m)},
                   {"angle_deg", text(report.angle_rad * kDegreesPerRadian)},
                   {"mode", report.jumped ? "jump" : "slew"}};
  DiagnosticArray message{report.stamp, entities_->map_frame, {status}};
  return entities_->correction_writer->write(&message);
}

int MapPublisher::local_map_subscribers() const { return matched_subscribers(*entities_->local_map_writer); }

}  // namespace nilio::dds
