#pragma once

#include "nilio/drivers/source.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tests {

/// Packets and frames of a drive in memory, with injected faults.
struct Recording {
  std::vector<drivers::Packet> packets;
  std::vector<drivers::CanFrame> frames;
};
/// Simulates a drive with `nilio simulate` once per process: VLP-16 with GPS and Xsens IMU in the town.
const Recording& town_drive();
/// Configuration of that drive.
std::string town_configuration();
/// Folder of its files for the lifetime of the process.
std::string town_folder();

/// Fault of a packet.
enum class Fate { kAsItIs, kLost, kDamaged, kWrongLength, kTooLong };

/// Faults of a drive by the time since its start; the same in every run.
struct Faults {
  bool enabled = false;
  [[nodiscard]] Fate of_packet(std::size_t index, core::Duration since_start) const;
  /// The IMU is silent.
  [[nodiscard]] bool is_frame_lost(core::Duration since_start) const;
};

/// Plays a drive repeatedly: in each round the vehicle is back at the start and the sensor's clock has
/// jumped. Reading does not allocate. `speed`: factor relative to the recording; 0 = as fast as possible.
class RepeatedPackets final : public drivers::PacketSource {
 public:
  RepeatedPackets(const Recording& recording, std::size_t times, const Faults& faults, double speed = 0.0)
      : recording_(recording), times_(times), faults_(faults), speed_(speed) {}
  drivers::SourceRead read(std::span<drivers::Packet> slots, core::Duration timeout) override;
  [[nodiscard]] drivers::SourceStats stats() const override { return {}; }
  [[nodiscard]] std::string status() const override { return "a drive in memory"; }

 private:
  bool next(drivers::Packet& slot);

  const Recording& recording_;
  std::size_t times_;
  Faults faults_;
  double speed_;
  std::int64_t begun_ns_ = 0;
  std::size_t round_ = 0;
  std::size_t index_ = 0;
};

/// Frames that belong to RepeatedPackets.
class RepeatedFrames final : public drivers::FrameSource {
 public:
  RepeatedFrames(const Recording& recording, std::size_t times, const Faults& faults)
      : recording_(recording), times_(times), faults_(faults) {}
  drivers::SourceRead read(std::span<drivers::CanFrame> slots, core::Duration timeout) override;
  [[nodiscard]] drivers::SourceStats stats() const override { return {}; }
  [[nodiscard]] std::string status() const override { return "a drive's frames in memory"; }

 private:
  bool next(drivers::CanFrame& slot);

  const Recording& recording_;
  std::size_t times_;
  Faults faults_;
  std::size_t round_ = 0;
  std::size_t index_ = 0;
};

}  // namespace nilio::tests
