#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/dds/participant.hpp"
#include "ipc/messages/messages.hpp"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::dds {

struct OdometrySubscriberConfig {
  ParticipantConfig participant;
  std::string topic_prefix;
  std::size_t queue_capacity = 4096;  ///< samples that wait for next()
  bool imu_rate = false;              ///< receive IMU-rate poses instead of scan poses
};

struct ReceivedOdometry {
  Odometry message;
  core::Time written;            ///< source timestamp of the writer, its clock
  core::Time received;           ///< this machine's clock, right after deserialisation
  std::int64_t received_ns = 0;  ///< the same moment on CLOCK_MONOTONIC
};

struct SubscriberCounts {
  std::uint64_t received = 0;
  std::uint64_t lost = 0;           ///< gaps in a writer's sequence numbers
  std::uint64_t queue_dropped = 0;  ///< received while the queue was full
  std::uint64_t writers_seen = 0;   ///< more than one: the publisher was restarted, or there are several
  int publishers = 0;               ///< currently matched
};

/// Receives odometry, reports and diagnostics. The DDS threads only copy into queues; next() may be called by
/// one thread. Numbers in a message may have any value, including not finite: they come from the network.
class OdometrySubscriber {
 public:
  static core::Result<std::unique_ptr<OdometrySubscriber>> create(const OdometrySubscriberConfig& config);
  ~OdometrySubscriber();
  OdometrySubscriber(const OdometrySubscriber&) = delete;
  OdometrySubscriber& operator=(const OdometrySubscriber&) = delete;

  /// Oldest message not taken yet; waits up to `timeout`.
  std::optional<ReceivedOdometry> next(core::Duration timeout);
  /// Scan reports since the last call, in order; a full queue drops the oldest.
  std::vector<ScanReport> scan_reports();
  /// IMU pose statuses since the last call, in order.
  std::vector<ImuPoseStatus> imu_statuses();
  /// Latest report, if any.
  [[nodiscard]] std::optional<LatencyReport> latency_report() const;
  /// Latest diagnostics, if any; may come from another program.
  [[nodiscard]] std::optional<DiagnosticArray> diagnostics() const;
  [[nodiscard]] SubscriberCounts counts() const;

 private:
  struct Entities;
  explicit OdometrySubscriber(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

}  // namespace nilio::dds
