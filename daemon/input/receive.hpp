#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/source.hpp"

#include "daemon/realtime/thread_plan.hpp"
#include "ipc/publisher_process.hpp"
#include "ipc/ring.hpp"
#include "ipc/wake_event.hpp"

#include <atomic>
#include <cstdint>
#include <optional>

namespace nilio::daemon {

/// CLOCK_MONOTONIC and CLOCK_REALTIME, ns.
std::int64_t monotonic_ns();
std::int64_t realtime_ns();

/// Plays a recording at its own pace: a stamp is due as long after `start_ns` (CLOCK_MONOTONIC) as it lies
/// after `origin`.
struct Pace {
  core::Time origin;
  std::int64_t start_ns = 0;
};

struct ReceivePolicy {
  /// Full ring: true = wait for room (a recording loses nothing), false = drop the newest and count it
  /// (live).
  bool wait_when_full = false;
  std::optional<Pace> pace;
  ThreadHook hook = nullptr;
};

/// What a receive thread and the others share. The flags go from false to true once.
struct ReceiveState {
  std::atomic<bool> stop{false};    ///< wanted by the supervisor
  std::atomic<bool> ended{false};   ///< nothing more will come; set after the last commit
  std::atomic<bool> failed{false};  ///< ended because the source is gone
  std::atomic<std::uint64_t> heartbeat{0};
};

/// Body of the LiDAR receive thread: moves packets from the source into ring slots in place, without looking
/// at them. Returns at the end of the source, on failure and on stop.
void receive_packets(drivers::PacketSource& source, ipc::Ring<drivers::Packet>& ring,
                     ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state);

/// Body of the IMU receive thread: frames to samples, for the odometry and, unless null, for the publisher's
/// poses at IMU rate, who gets them at once and never holds this thread up.
void receive_imu(drivers::FrameSource& source, drivers::ImuDecoder& decoder, ipc::Ring<core::ImuSample>& ring,
                 ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
                 ipc::PublisherProcess* publisher = nullptr);

}  // namespace nilio::daemon
