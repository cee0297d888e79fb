#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/dds/messages.hpp"
#include "ipc/dds/participant.hpp"

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
  bool imu_rate = false;              ///< poses at IMU rate instead of those of the scans
};

struct ReceivedOdometry {
  Odometry message;
  core::Time written;            ///< source timestamp of the writer, its clock
  core::Time received;           ///< this machine's clock, right after deserialisation
  std::int64_t received_ns = 0;  ///< the same moment on CLOCK_MONOTONIC
};

struct SubscriberCounts {
  std::uint64_t received = 0;
  std::uint64_t lost = 0;           ///< missing in a writer's sequence numbers
  std::uint64_t queue_dropped = 0;  ///< received while the queue was full
  std::uint64_t writers_seen = 0;   ///< more than one: the publisher was started again, or there are several
  int publishers = 0;               ///< matched at the moment
};

/// Receives odometry, reports and diagnostics. The DDS threads only copy into queues; next() may be called by
/// one thread. Numbers in a message may be anything, also not finite: it comes from the network.
class OdometrySubscriber {
 public:
  static core::Result<std::unique_ptr<OdometrySubscriber>> create(const OdometrySubscriberConfig& config);
  ~OdometrySubscriber();
  OdometrySubscriber(const OdometrySubscriber&) = delete;
  OdometrySubscriber& operator=(const OdometrySubscriber&) = delete;

  /// The oldest message not yet taken; waits up to `timeout` for one.
  std::optional<ReceivedOdometry> next(core::Duration timeout);
  /// Reports of scans that have come since the last call, in order; the oldest make room.
  std::vector<ScanReport> scan_reports();
  /// The same of the poses at IMU rate.
  std::vector<ImuPoseStatus> imu_statuses();
  /// The latest report, if any has come.
  [[nodiscard]] std::optional<LatencyReport> latency_report() const;
  /// The latest diagnostics, if any have come: nilio's or another program's.
  [[nodiscard]] std::optional<DiagnosticArray> diagnostics() const;
  [[nodiscard]] SubscriberCounts counts() const;

 private:
  struct Entities;
  explicit OdometrySubscriber(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

}  // namespace nilio::dds
