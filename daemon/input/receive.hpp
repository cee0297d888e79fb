#pragma once

#include "nilio/core/clock.hpp"
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

/// Paced replay: a stamp is due at `start_ns` (CLOCK_MONOTONIC) plus its distance from `origin`.
struct Pace {
  core::Time origin;
  std::int64_t start_ns = 0;
};

struct ReceivePolicy {
  /// Behaviour when the ring is full: true = wait (replay), false = drop the newest and count it (live).
  bool wait_when_full = false;
  std::optional<Pace> pace;
  ThreadHook hook = nullptr;
};

/// State shared by a receive thread and the others. The flags change from false to true once.
struct ReceiveState {
  std::atomic<bool> stop{false};    ///< requested by the supervisor
  std::atomic<bool> ended{false};   ///< end of the source; set after the last commit
  std::atomic<bool> failed{false};  ///< ended because of a source failure
  std::atomic<std::uint64_t> heartbeat{0};
};

/// Body of the LiDAR receive thread: moves packets from the source into ring slots in place. Returns at the
/// end of the source, on failure and on stop.
void receive_packets(drivers::PacketSource& source, ipc::Ring<drivers::Packet>& ring,
                     ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state);

/// Body of the IMU receive thread: decodes CAN frames into samples for the odometry ring and, unless null,
/// for the publisher's IMU-rate poses. The publisher never blocks this thread.
void receive_imu(drivers::FrameSource& source, drivers::ImuDecoder& decoder, ipc::Ring<core::ImuSample>& ring,
                 ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
                 ipc::PublisherProcess* publisher = nullptr);

}  // namespace nilio::daemon
