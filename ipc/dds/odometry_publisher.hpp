#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/dds/participant.hpp"
#include "ipc/messages/messages.hpp"
#include "ipc/records.hpp"

#include <memory>
#include <string>

namespace nilio::dds {

struct OdometryPublisherConfig {
  ParticipantConfig participant;
  std::string odom_frame = "odom";
  std::string base_frame = "base_link";
  std::string topic_prefix;
  bool transform = true;  ///< false: publish_transform() does nothing
};

/// Fills the odometry message except for its frame names.
void fill_odometry(const ipc::PoseRecord& record, Odometry& odometry);

/// DDS writers of nilio: odometry, transform, reports and diagnostics. Reliable and volatile, so that both
/// reliable (rviz2) and best-effort subscribers match. A subscriber that does not read never blocks a write:
/// the oldest of the last ten samples is overwritten. One thread publishes poses, transforms and scan
/// reports, one may publish the rest.
class OdometryPublisher {
 public:
  static constexpr int kHistoryDepth = 10;

  static core::Result<std::unique_ptr<OdometryPublisher>> create(const OdometryPublisherConfig& config);
  ~OdometryPublisher();
  OdometryPublisher(const OdometryPublisher&) = delete;
  OdometryPublisher& operator=(const OdometryPublisher&) = delete;

  /// All return false if DDS refused the write.
  bool publish_odometry(const ipc::PoseRecord& record);
  bool publish_transform(const ipc::PoseRecord& record);
  /// Does not change `report`; write() takes a pointer to non-const.
  bool publish_latency(LatencyReport& report);
  bool publish_scan_report(const ScanReport& report);
  bool publish_diagnostics(const DiagnosticArray& diagnostics);

  /// Number of matched subscribers: the larger of odometry and transform.
  [[nodiscard]] int subscribers() const;
  /// Those of the transform; topics are discovered one after another.
  [[nodiscard]] int transform_subscribers() const;
  /// Waits until all reliable subscribers have received the poses, transforms and scan reports; false after
  /// `timeout`. For the thread that publishes them.
  bool wait_for_pose_acknowledgments(core::Duration timeout);
  /// The same for everything; no thread may publish meanwhile.
  bool wait_for_acknowledgments(core::Duration timeout);
  [[nodiscard]] Participant& participant();

 private:
  struct Entities;
  explicit OdometryPublisher(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

}  // namespace nilio::dds
