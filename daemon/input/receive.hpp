#pragma once

#include "nilio/core/clock.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/bag/sources.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/imu/detect.hpp"
#include "nilio/drivers/source.hpp"

#include "daemon/realtime/run_rules.hpp"
#include "ipc/publisher_process.hpp"
#include "ipc/ring.hpp"
#include "ipc/wake_event.hpp"

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>

namespace nilio::daemon {

/// Paced replay: a stamp is due at `start_ns` (CLOCK_MONOTONIC) plus its distance from `origin`.
struct Pace {
  core::Time origin;
  std::int64_t start_ns = 0;
};

struct ReceivePolicy {
  RunRules rules;
  std::optional<Pace> pace;
  /// Live: before this CLOCK_MONOTONIC time no packet can complete a scan, and packets may gather in the
  /// socket for kGatherTime; null = every packet wakes the odometry.
  const std::atomic<std::int64_t>* gather_until_ns = nullptr;
};

/// At most one wake-up of receive and odometry thread in this time while packets may gather. 92 packets, 15
/// ms of a VLS-128, fit into the kernel's default buffer.
inline constexpr core::Duration kGatherTime = core::Duration::from_milliseconds(1.0);

/// State shared by a receive thread and the others. The flags change from false to true once.
struct ReceiveState {
  std::atomic<bool> stop{false};    ///< requested by the supervisor
  std::atomic<bool> ended{false};   ///< end of the source; set after the last commit
  std::atomic<bool> failed{false};  ///< ended because of a source failure
  /// Packets and frames that were received, but dropped in the kernel's buffer or for a full ring; not lost
  /// in the network. Set at the end.
  std::atomic<std::uint64_t> data_dropped{0};
  /// The odometry thread waits for a sample; otherwise samples do not wake it.
  std::atomic<bool> is_awaited{false};
};

/// Work of a LiDAR receive thread: moves packets from the source into ring slots in place. All references
/// must outlive it.
class PacketReceiver {
 public:
  /// Unless null, `recorded` gets a copy of each packet in the ring.
  PacketReceiver(drivers::PacketSource& source, ipc::Ring<drivers::Packet>& ring, ipc::WakeEvent& data_event,
                 const ReceivePolicy& policy, ReceiveState& state,
                 ipc::Ring<drivers::Packet>* recorded = nullptr);

  /// One round: at most one batch. False at the end of the source, on failure and on stop.
  bool run();
  /// Announces the end; after the last round.
  void finish();

 private:
  static constexpr std::size_t kBatch = 64;

  drivers::PacketSource& source_;
  ipc::Ring<drivers::Packet>& ring_;
  ipc::WakeEvent& data_event_;
  const ReceivePolicy& policy_;
  ReceiveState& state_;
  ipc::Ring<drivers::Packet>* recorded_;
  /// Packet of a paced replay that is not due yet.
  std::span<drivers::Packet> held_;
  bool at_end_ = false;
  std::uint64_t data_dropped_ = 0;
  /// Destination of packets when the ring is full: they must leave the socket to be counted.
  std::unique_ptr<std::array<drivers::Packet, kBatch>> overflow_;
};

/// Work of the IMU receive thread: decodes CAN frames into samples for the odometry ring and, unless null,
/// for the publisher's IMU-rate poses. The publisher never blocks this thread. An IMU without a decoder is
/// identified first; its samples until then follow at once. All references must outlive it.
class ImuReceiver {
 public:
  /// `decoder` is empty if `identification`, otherwise null, is to set it. Unless null, `recorded` gets a
  /// copy of each received frame.
  ImuReceiver(drivers::FrameSource& source, std::optional<drivers::ImuDecoder>& decoder,
              drivers::ImuIdentification* identification, ipc::Ring<core::ImuSample>& ring,
              ipc::WakeEvent& data_event, const ReceivePolicy& policy, ReceiveState& state,
              ipc::PublisherProcess* publisher = nullptr, ipc::Ring<drivers::CanFrame>* recorded = nullptr);

  /// One round: at most one batch. False at the end of the source, on failure and on stop.
  bool run();
  /// Announces the end; after the last round.
  void finish();

 private:
  static constexpr std::size_t kBatch = 64;

  /// False while the frame is not due or its sample has no room.
  bool take(const drivers::CanFrame& frame);
  bool deliver_backlog();
  void deliver(const core::ImuSample& sample, std::int64_t received_ns);

  drivers::FrameSource& source_;
  std::optional<drivers::ImuDecoder>& decoder_;
  drivers::ImuIdentification* identification_;
  ipc::Ring<core::ImuSample>& ring_;
  ipc::WakeEvent& data_event_;
  const ReceivePolicy& policy_;
  ReceiveState& state_;
  ipc::PublisherProcess* publisher_;
  ipc::Ring<drivers::CanFrame>* recorded_;
  std::unique_ptr<std::array<drivers::CanFrame, kBatch>> frames_;
  /// Frames read and not yet taken.
  std::span<const drivers::CanFrame> waiting_;
  /// Samples of the identification that are not delivered yet.
  std::span<const drivers::ReceivedSample> backlog_;
  bool at_end_ = false;
};

/// Work of the IMU receive thread for recorded samples: as ImuReceiver, without decoding.
class SampleReceiver {
 public:
  SampleReceiver(drivers::SampleSource& source, ipc::Ring<core::ImuSample>& ring, ipc::WakeEvent& data_event,
                 const ReceivePolicy& policy, ReceiveState& state,
                 ipc::PublisherProcess* publisher = nullptr);

  /// One round: at most one batch. False at the end of the source, on failure and on stop.
  bool run();
  /// Announces the end; after the last round.
  void finish();

 private:
  static constexpr std::size_t kBatch = 64;

  drivers::SampleSource& source_;
  ipc::Ring<core::ImuSample>& ring_;
  ipc::WakeEvent& data_event_;
  const ReceivePolicy& policy_;
  ReceiveState& state_;
  ipc::PublisherProcess* publisher_;
  std::array<core::ImuSample, kBatch> samples_{};
  /// Samples read and not yet delivered.
  std::span<const core::ImuSample> waiting_;
  bool at_end_ = false;
};

}  // namespace nilio::daemon
