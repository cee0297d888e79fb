#pragma once

#include "nilio/core/result.hpp"

#include "ipc/dds/participant.hpp"
#include "ipc/messages/messages.hpp"
#include "ipc/scan_cloud.hpp"

#include <initializer_list>
#include <memory>
#include <string>

namespace nilio::dds {

struct CloudPublisherConfig {
  ParticipantConfig participant;
  std::string odom_frame = "odom";
  std::string topic_prefix;
};

/// Gives a cloud float32 fields with the names, without gaps.
void set_fields(PointCloud2& cloud, std::initializer_list<const char*> names);
/// Fills time, number and data of a cloud with the fields x, y, z, intensity: the first `max_points` points
/// of the scan in odom.
void fill_cloud(const ipc::ScanCloud& scan, std::size_t max_points, PointCloud2& cloud);

/// DDS writers of large samples: registered scans and the path. They have a participant of their own, with
/// its own sockets and threads: a datagram of a pose never waits behind those of a cloud, and no thread that
/// serves poses works for clouds. Reliable and volatile, which matches rviz2 and Foxglove as they are; a
/// subscriber that does not read never blocks a write. One thread.
class CloudPublisher {
 public:
  static core::Result<std::unique_ptr<CloudPublisher>> create(const CloudPublisherConfig& config);
  ~CloudPublisher();
  CloudPublisher(const CloudPublisher&) = delete;
  CloudPublisher& operator=(const CloudPublisher&) = delete;

  /// Both return false if DDS refused the write.
  bool publish_scan(const ipc::ScanCloud& scan, std::size_t max_points);
  /// Does not change `path`, apart from the frame names.
  bool publish_path(Path& path);

  [[nodiscard]] int scan_subscribers() const;
  [[nodiscard]] int path_subscribers() const;
  [[nodiscard]] Participant& participant();

 private:
  struct Entities;
  explicit CloudPublisher(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

}  // namespace nilio::dds
