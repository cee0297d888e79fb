#pragma once

#include "nilio/drivers/source.hpp"

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tests {

/// Packets and frames of a drive in memory, and what is done to them on the way.
struct Recording {
  std::vector<drivers::Packet> packets;
  std::vector<drivers::CanFrame> frames;
};
/// Makes a drive with `nilio simulate`, once a process: a VLP-16 with GPS and an Xsens IMU in the town.
const Recording& town_drive();
/// Configuration of that drive.
std::string town_configuration();
/// Where its files are, as long as the process lives.
std::string town_folder();

/// What happens to a packet.
enum class Fate { kAsItIs, kLost, kDamaged, kWrongLength, kTooLong };

/// Where faults come in a drive, by the time since its beginning; the same every time.
struct Faults {
  bool enabled = false;
  [[nodiscard]] Fate of_packet(std::size_t index, core::Duration since_start) const;
  /// The IMU says nothing.
  [[nodiscard]] bool is_frame_lost(core::Duration since_start) const;
};

/// Plays a drive so many times, one after the other: each time the vehicle is back at the start, and the
/// sensor's clock has jumped. Does not allocate while it is read. `speed`: so many times as fast as it was
/// recorded; 0 = as fast as it is read.
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

/// The frames that go with RepeatedPackets.
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
