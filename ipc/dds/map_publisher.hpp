#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/se3.hpp"
#include "nilio/core/time.hpp"

#include "ipc/dds/participant.hpp"
#include "ipc/messages/messages.hpp"

#include <memory>
#include <span>
#include <string>

namespace nilio::dds {

struct MapPublisherConfig {
  ParticipantConfig participant;
  std::string map_frame = "map";
  std::string odom_frame = "odom";
  std::string topic_prefix;
  int kept_submaps = 20;  ///< submaps for late subscribers
};

/// Point of a map cloud: fields x, y, z, intensity, normal_x, normal_y, normal_z, curvature (the thickness of
/// the surface, m) of PointCloud2.
struct SurfacePoint {
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;
  float intensity = 0.0F;
  float normal_x = 0.0F;
  float normal_y = 0.0F;
  float normal_z = 0.0F;
  float curvature = 0.0F;
};

/// Change of map -> odom.
struct MapCorrectionReport {
  core::Time stamp;   ///< of the last keyframe
  std::string cause;  ///< loops that were closed or given up
  std::size_t loops = 0;
  double distance_m = 0.0;  ///< of the vehicle in map
  double angle_rad = 0.0;
  bool jumped = false;  ///< else it enters gradually
};

/// DDS writers of nilio-mapper: submaps and their poses, kept for late subscribers, the local map, the
/// transform from map to odom and its changes. All reliable. One thread.
class MapPublisher {
 public:
  static core::Result<std::unique_ptr<MapPublisher>> create(const MapPublisherConfig& config);
  ~MapPublisher();
  MapPublisher(const MapPublisher&) = delete;
  MapPublisher& operator=(const MapPublisher&) = delete;

  /// A complete submap in the map frame; `stamp`: of its first keyframe, as in submap_poses. All functions
  /// return false if DDS refused the write.
  bool publish_submap(core::Time stamp, std::span<const SurfacePoint> points);
  /// Poses of all submaps; does not change them, apart from the frame names.
  bool publish_poses(Path& poses);
  bool publish_local_map(core::Time stamp, std::span<const SurfacePoint> points);
  /// A static transform, of which listeners keep the last: it holds while the mapper is dead or busy.
  bool publish_transform(core::Time stamp, const core::SE3& T_map_odom);
  bool publish_correction(const MapCorrectionReport& report);

  [[nodiscard]] int local_map_subscribers() const;
  [[nodiscard]] Participant& participant();

 private:
  struct Entities;
  explicit MapPublisher(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

}  // namespace nilio::dds
