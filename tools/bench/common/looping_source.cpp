#include "tools/bench/common/looping_source.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include <atomic>
#include <utility>

namespace nilio::tools::bench {

namespace {

using core::Duration;
using core::Error;
using core::Result;
using core::Time;
using drivers::CanFrame;
using drivers::Packet;
using drivers::SourceRead;
using drivers::SourceState;

constexpr std::size_t kBatch = 64;

Result<std::unique_ptr<drivers::PacketSource>> open_lap(const SensorDrive& drive, const Packet* /*slot*/) {
  drivers::PcapSourceConfig config;
  config.data_port = static_cast<std::uint16_t>(drive.config.lidar.port);
  config.position_port = 0;
  config.sender_address = drive.config.lidar.sender_address;
  return drivers::chain_captures(drive.files.captures, config);
}

Result<std::unique_ptr<drivers::FrameSource>> open_lap(const SensorDrive& drive, const CanFrame* /*slot*/) {
  return drivers::chain_can_logs(drive.files.can_logs, drive.config.imu.interface_name);
}

/// Sets the sensor's time at the start of each lap to the stamp of its first packet, so that it increases.
class SensorClock {
 public:
  void begin_lap() { restamper_.restart(); }
  void move(Packet& packet) { restamper_.apply(packet, packet.stamp); }
  void move(CanFrame& /*frame*/) {}

 private:
  play::Restamper restamper_;
};

template <class Slot>
class LoopingSource final : public drivers::Source<Slot> {
 public:
  explicit LoopingSource(LoopPlan plan) : plan_(std::move(plan)) {}

  SourceRead read(std::span<Slot> slots, Duration timeout) override {
    while (next_lap_ <= plan_.laps.size()) {
      if (inner_) {
        const SourceRead read = inner_->read(slots, timeout);
        if (read.state == SourceState::kData) {
          const std::size_t kept = move(slots.first(read.count));
          if (ended_) next_lap_ = plan_.laps.size() + 1;
          if (kept == 0) continue;
          delivered_.fetch_add(kept, std::memory_order_relaxed);
          return {SourceState::kData, kept};
        }
        if (read.state == SourceState::kFailed) return read;
      }
      if (next_lap_ == plan_.laps.size()) break;
      const auto opened = open_next();
      if (!opened) {
        failed_.store(true);
        return {SourceState::kFailed, 0};
      }
    }
    return {SourceState::kEnd, 0};
  }

  [[nodiscard]] drivers::SourceStats stats() const override {
    return {.delivered = delivered_.load(std::memory_order_relaxed)};
  }
  [[nodiscard]] std::string status() const override {
    return std::string("drives in a loop") + (failed_.load() ? "; one of them cannot be opened again" : "");
  }

 private:
  Result<std::monostate> open_next() {
    const auto& lap = plan_.laps[next_lap_];
    auto source = open_lap(*lap.drive, static_cast<const Slot*>(nullptr));
    if (!source) return source.error();
    inner_ = std::move(source).value();
    ++next_lap_;
    clock_.begin_lap();
    return std::monostate{};
  }

  /// Shifts stamps and moves the packets of the plan to the front. Returns their number.
  std::size_t move(std::span<Slot> slots) {
    const auto& lap = plan_.laps[next_lap_ - 1];
    std::size_t kept = 0;
    for (std::size_t i = 0; i < slots.size(); ++i) {
      if (slots[i].stamp < lap.first || slots[i].stamp > lap.last) continue;
      slots[i].stamp = slots[i].stamp + lap.shift;
      ended_ = ended_ || slots[i].stamp > plan_.end;
      if (ended_) break;
      clock_.move(slots[i]);
      if (kept != i) slots[kept] = slots[i];
      ++kept;
    }
    return kept;
  }

  const LoopPlan plan_;
  std::size_t next_lap_ = 0;
  std::unique_ptr<drivers::Source<Slot>> inner_;
  SensorClock clock_;
  bool ended_ = false;
  std::atomic<std::uint64_t> delivered_{0};
  std::atomic<bool> failed_{false};
};

/// First and last stamp of a drive's packets.
Result<std::pair<Time, Time>> find_span(const SensorDrive& drive) {
  auto source = open_lap(drive, static_cast<const Packet*>(nullptr));
  if (!source) return source.error();
  std::vector<Packet> slots(kBatch);
  std::pair<Time, Time> span;
  bool begun = false;
  for (;;) {
    const SourceRead read = (*source)->read(slots, Duration{});
    if (read.state != SourceState::kData) break;
    if (!std::exchange(begun, true)) span = {slots.front().stamp, slots.front().stamp};
    for (std::size_t i = 0; i < read.count; ++i) span.second = std::max(span.second, slots[i].stamp);
  }
  if (!begun || span.second <= span.first)
    return Error{drive.name + ": has no packets (" + (*source)->status() + ") - leave it out"};
  return span;
}

}  // namespace

Result<LoopPlan> plan_laps(std::span<const SensorDrive> drives, Duration length) {
  std::vector<std::pair<Time, Time>> spans;
  for (const SensorDrive& drive : drives) {
    const auto span = find_span(drive);
    if (!span) return span.error();
    spans.push_back(*span);
  }
  if (spans.empty()) return Error{"no drive to play in a loop - name one"};
  LoopPlan plan;
  Time next = spans.front().first;
  plan.end = next + length;
  for (std::size_t i = 0; next < plan.end; i = (i + 1) % drives.size()) {
    const auto& [first, last] = spans[i];
    plan.laps.push_back({&drives[i], first, last, next - first});
    next = last + plan.laps.back().shift + kLapGap;
  }
  return plan;
}

Result<std::unique_ptr<drivers::PacketSource>> loop_packets(const LoopPlan& plan) {
  return std::unique_ptr<drivers::PacketSource>(new LoopingSource<Packet>(plan));
}

Result<std::unique_ptr<drivers::FrameSource>> loop_frames(const LoopPlan& plan) {
  for (const LoopPlan::Lap& lap : plan.laps) {
    if (lap.drive->files.can_logs.empty())
      return Error{lap.drive->name +
                   ": has no CAN log, unlike other drives - leave it out, or set imu.enabled=false"};
  }
  return std::unique_ptr<drivers::FrameSource>(new LoopingSource<CanFrame>(plan));
}

}  // namespace nilio::tools::bench
