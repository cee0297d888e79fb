#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/histogram.hpp"
#include "tools/watch/packet_to_pose.hpp"

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <thread>

namespace nilio::tools::bench {

/// DDS subscriber to the poses of nilio-publisher on this computer, with a thread of its own. The getters may
/// be called from any thread unless noted.
class PoseListener {
 public:
  /// Listens on the loopback interface.
  static core::Result<std::unique_ptr<PoseListener>> start(std::uint32_t domain);
  PoseListener(const PoseListener&) = delete;
  PoseListener& operator=(const PoseListener&) = delete;
  ~PoseListener() { stop(); }

  /// True once a publisher is matched.
  [[nodiscard]] bool is_connected() const { return subscriber_->counts().publishers > 0; }
  [[nodiscard]] std::uint64_t poses() const { return poses_.load(); }
  /// CLOCK_MONOTONIC of the last pose; 0 = none yet.
  [[nodiscard]] std::int64_t last_pose_ns() const { return last_pose_ns_.load(); }
  /// Time from the writer's stamp to the reader's.
  [[nodiscard]] const ipc::Histogram& transport() const { return *transport_; }
  /// Time from the reception of a scan's last packet to its pose here. Only after stop().
  [[nodiscard]] const ipc::Histogram& packet_to_pose() const { return packet_to_pose_.histogram(); }
  /// Takes the remaining samples and ends the thread. May be called again.
  void stop();
  [[nodiscard]] std::optional<dds::LatencyReport> latency_report() const {
    return subscriber_->latency_report();
  }

 private:
  explicit PoseListener(std::unique_ptr<dds::OdometrySubscriber> subscriber);
  void run();

  std::unique_ptr<dds::OdometrySubscriber> subscriber_;
  watch::PacketToPose packet_to_pose_;
  std::unique_ptr<ipc::Histogram> transport_ = std::make_unique<ipc::Histogram>();
  std::atomic<std::uint64_t> poses_{0};
  std::atomic<std::int64_t> last_pose_ns_{0};
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace nilio::tools::bench
