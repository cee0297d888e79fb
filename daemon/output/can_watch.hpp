#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/can/can_controller.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/source.hpp"

#include "daemon/config/config.hpp"

#include <array>
#include <atomic>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace nilio::daemon {

/// What has come by on the bus, written by the IMU's receive thread and read by the supervisor.
struct CanTraffic {
  static constexpr std::size_t kIds = 7;
  std::atomic<std::uint64_t> imu_frames{0};
  std::atomic<std::uint64_t> other_frames{0};
  std::atomic<std::uint64_t> error_frames{0};
  /// Classes of the error frames since the supervisor last took them.
  std::atomic<std::uint32_t> error_classes{0};
  /// Plus 1, so that 0 is none: the first other identifiers that were seen.
  std::array<std::atomic<std::uint32_t>, kIds> other_ids{};

  /// `takes`: the frame is one of the IMU's.
  void count(const drivers::CanFrame& frame, bool takes);
};

/// Hands on the frames of another source and counts them on the way.
class WatchedFrames final : public drivers::FrameSource {
 public:
  WatchedFrames(std::unique_ptr<drivers::FrameSource> source, drivers::ImuFrameFilter filter,
                std::shared_ptr<CanTraffic> traffic);
  drivers::SourceRead read(std::span<drivers::CanFrame> slots, core::Duration timeout) override;
  [[nodiscard]] drivers::SourceStats stats() const override { return source_->stats(); }
  [[nodiscard]] std::string status() const override { return source_->status(); }

 private:
  std::unique_ptr<drivers::FrameSource> source_;
  /// Only asked which identifiers are the IMU's.
  const drivers::ImuFrameFilter filter_;
  std::shared_ptr<CanTraffic> traffic_;
};

/// Tells when the IMU falls silent and comes back, each once. Knows no clock. One thread.
class ImuSilence {
 public:
  ImuSilence(std::shared_ptr<CanTraffic> traffic, std::string identifiers);

  /// `now_ns`: monotonic; the first call is the beginning. `bus` is the state to name beside the silence.
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

/// The IMU's bus and the frames on it, live: what the supervisor logs and counts of them.
class CanWatch {
 public:
  CanWatch(std::unique_ptr<drivers::CanController> controller, std::shared_ptr<CanTraffic> traffic,
           std::string identifiers);

  /// Lines that are new. Does not wait.
  std::vector<drivers::CanEvent> poll(std::int64_t now_ns);
  /// For the summary, by name.
  [[nodiscard]] std::map<std::string, std::uint64_t> counters() const;

 private:
  std::unique_ptr<drivers::CanController> controller_;
  std::shared_ptr<CanTraffic> traffic_;
  ImuSilence silence_;
};

struct LiveCan {
  std::unique_ptr<drivers::FrameSource> frames;
  std::unique_ptr<CanWatch> watch;
};

/// Opens `config.interface_name` for reading and watching. An interface that is not there yet is waited for;
/// fails when it is there and not of CAN, and when the kernel has no CAN.
core::Result<LiveCan> open_live_can(const ImuConfig& config, const drivers::ImuDecoder& decoder);

}  // namespace nilio::daemon
