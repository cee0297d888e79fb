#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/cloud_publisher.hpp"
#include "ipc/overwriting_ring.hpp"
#include "ipc/scan_cloud.hpp"
#include "ipc/wake_event.hpp"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <thread>
#include <vector>

namespace nilio::dds {

/// Shared-memory inputs of the thread of large samples in the publisher process.
struct CloudInputs {
  ipc::OverwritingRing<ipc::ScanCloud> scans;
  ipc::OverwritingRing<ipc::PathPose> path;
  ipc::WakeEvent wake;
};

struct CloudLimits {
  std::size_t scan_points = ipc::ScanCloud::kCapacity;  ///< of a scan; 0: no scans
  double scan_rate_max_hz = 10.0;
  std::size_t path_poses = 10'000;  ///< the newest; 0: no path
};

/// Limits a rate on average, by the stamps of what is limited.
class RateLimit {
 public:
  explicit RateLimit(double max_hz)
      : period_(max_hz > 0.0 ? core::Duration::from_seconds(1.0 / max_hz) : core::Duration{0}) {}
  /// Whether a sample with this stamp passes. Stamps that go back begin anew.
  bool passes(core::Time stamp);

 private:
  core::Duration period_;
  std::optional<core::Time> last_;
  core::Time due_;
};

/// Thread that publishes registered scans and the path, at normal priority and with a participant of its own.
/// While nobody subscribes, nothing is sent, and niliod does not even prepare scans. The newest scan wins;
/// the others are counted as dropped.
class CloudLoop {
 public:
  struct Counts {
    std::uint64_t scans = 0;
    std::uint64_t paths = 0;
    std::uint64_t failed_writes = 0;
    std::uint64_t dropped = 0;  ///< scans that were overwritten before they were read
  };

  /// Makes the DDS entities, in the thread: their threads inherit its scheduling, and no other thread waits
  /// for them. Null: the loop ends.
  using MakePublisher = std::function<std::unique_ptr<CloudPublisher>()>;

  CloudLoop(CloudInputs inputs, MakePublisher make_publisher, const CloudLimits& limits);
  /// Stops the thread.
  ~CloudLoop();
  CloudLoop(const CloudLoop&) = delete;
  CloudLoop& operator=(const CloudLoop&) = delete;

  /// Starts the thread. It calls `prepare` first, which requests its priority.
  void start(std::function<void()> prepare);
  /// Ends the thread; an unpublished scan is dropped.
  void stop();
  /// Any thread.
  [[nodiscard]] Counts counts() const;

 private:
  void run();
  void publish_scan();
  void take_path();
  void publish_path(core::Time now);
  void count(bool accepted, std::atomic<std::uint64_t>& published);

  CloudInputs inputs_;
  MakePublisher make_publisher_;
  std::unique_ptr<CloudPublisher> publisher_;
  CloudLimits limits_;
  RateLimit scan_rate_;
  std::unique_ptr<ipc::ScanCloud> scan_ = std::make_unique<ipc::ScanCloud>();
  std::vector<ipc::PathPose> poses_;  ///< a ring once it is full
  std::size_t oldest_ = 0;
  Path path_;  // refilled
  bool path_changed_ = false;
  int path_subscribers_ = 0;
  core::Time path_due_;
  std::atomic<std::uint64_t> scans_{0};
  std::atomic<std::uint64_t> paths_{0};
  std::atomic<std::uint64_t> failed_{0};
  std::atomic<bool> stopping_{false};
  std::thread thread_;
};

}  // namespace nilio::dds
