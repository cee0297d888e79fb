#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/can/can_controller.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/imu/detect.hpp"
#include "nilio/drivers/source.hpp"

#include "daemon/config/config.hpp"
#include "daemon/output/event_log.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Traffic counters of the bus, written by the IMU receive thread and read by the supervisor.
struct CanTraffic {
  static constexpr std::size_t kIds = 7;
  std::atomic<std::uint64_t> imu_frames{0};
  std::atomic<std::uint64_t> other_frames{0};
  std::atomic<std::uint64_t> error_frames{0};
  /// Error classes since the supervisor last read them.
  std::atomic<std::uint32_t> error_classes{0};
  /// First other identifiers, plus 1 (0 = none).
  std::array<std::atomic<std::uint32_t>, kIds> other_ids{};

  /// `takes`: the frame belongs to the IMU.
  void count(const drivers::CanFrame& frame, bool takes);
};

/// Forwards the frames of another source and counts them.
class WatchedFrames final : public drivers::FrameSource {
 public:
  WatchedFrames(std::unique_ptr<drivers::FrameSource> source, drivers::ImuFrameFilter filter,
                std::shared_ptr<CanTraffic> traffic);
  drivers::SourceRead read(std::span<drivers::CanFrame> slots, core::Duration timeout) override;
  [[nodiscard]] drivers::SourceStats stats() const override { return source_->stats(); }
  [[nodiscard]] std::string status() const override { return source_->status(); }

 private:
  std::unique_ptr<drivers::FrameSource> source_;
  /// Used only to classify identifiers.
  const drivers::ImuFrameFilter filter_;
  std::shared_ptr<CanTraffic> traffic_;
};

/// Detects when the IMU falls silent and recovers, each reported once. Has no clock of its own. One thread.
class ImuSilence {
 public:
  ImuSilence(std::shared_ptr<CanTraffic> traffic, std::string identifiers);

  /// `now_ns`: monotonic; the first call is the start. `bus` is the bus state to report with the silence.
  std::vector<drivers::CanEvent> observe(std::int64_t now_ns, drivers::CanBusState bus);
  [[nodiscard]] std::uint64_t silences() const { return silences_; }

 private:
  [[nodiscard]] std::string seen_instead() const;

  std::shared_ptr<CanTraffic> traffic_;
  const std::string identifiers_;
  std::uint64_t frames_ = 0;
  std::uint64_t others_at_last_frame_ = 0;
  std::uint64_t errors_at_last_frame_ = 0;
  std::int64_t last_frame_ns_ = -1;
  bool silent_ = false;
  std::uint64_t silences_ = 0;
};

/// Reports once which IMU was identified, or that the frames of a bus are of no known one. Has no clock of
/// its own. One thread.
class ImuRecognition {
 public:
  /// `identification` is null for a configured IMU.
  ImuRecognition(std::shared_ptr<CanTraffic> traffic, std::string interface_name,
                 const drivers::ImuIdentification* identification);

  /// `now_ns`: monotonic.
  std::optional<EventLog::Line> observe(std::int64_t now_ns);

 private:
  std::shared_ptr<CanTraffic> traffic_;
  const std::string interface_name_;
  const drivers::ImuIdentification* identification_;
  /// First frames were seen; -1 = none yet.
  std::int64_t traffic_since_ns_ = -1;
  bool failed_ = false;
  bool recognised_ = false;
};

/// State of the IMU's live CAN bus for the supervisor's log and counters.
class CanWatch {
 public:
  CanWatch(std::unique_ptr<drivers::CanController> controller, std::shared_ptr<CanTraffic> traffic,
           std::string identifiers, ImuRecognition recognition);

  /// New events. Does not block.
  std::vector<drivers::CanEvent> poll(std::int64_t now_ns);
  /// Once: which IMU was identified, or that there is none; see ImuRecognition.
  std::optional<EventLog::Line> recognise(std::int64_t now_ns) { return recognition_.observe(now_ns); }
  /// Counters for the summary, by name.
  [[nodiscard]] std::map<std::string, std::uint64_t> counters() const;

 private:
  std::unique_ptr<drivers::CanController> controller_;
  std::shared_ptr<CanTraffic> traffic_;
  ImuSilence silence_;
  ImuRecognition recognition_;
};

struct LiveCan {
  std::unique_ptr<drivers::FrameSource> frames;
  std::unique_ptr<CanWatch> watch;
};

/// Opens `config.interface_name` for reading and monitoring. Waits for an interface that does not exist yet;
/// fails if it is not a CAN interface or the kernel has no CAN support. `filter` recognises the IMU's frames;
/// `identification` is null for a configured IMU and must outlive the watch.
core::Result<LiveCan> open_live_can(const ImuConfig& config, const drivers::ImuFrameFilter& filter,
                                    const drivers::ImuIdentification* identification);

}  // namespace nilio::daemon
