#include "tests/realtime/replayed_drive.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/read_all.hpp"
#include "tests/support/room_drive.hpp"

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>

#include <catch2/catch.hpp>

namespace nilio::tests {

namespace {

using core::Duration;

constexpr const char* kDriveSeconds = "80";
// Pause from the end of one round to the start of the next.
constexpr Duration kPause = Duration::from_seconds(5.0);

struct SimulatedDrive {
  TemporaryFolder folder;
  Recording recording;
  std::string configuration;
};

void simulate(SimulatedDrive& drive) {
  const std::string path = drive.folder.path().string();
  const std::string command = program_folder() + "/nilio simulate " + path + " --realism ideal --duration " +
                              kDriveSeconds + " > /dev/null 2>&1";
  REQUIRE(std::system(command.c_str()) == 0);
  auto packets = drivers::open_pcap(path + "/lidar.pcap", {});
  REQUIRE(packets.ok());
  drive.recording.packets = read_all(**packets);
  auto frames = drivers::open_candump(path + "/imu.candump.log", "");
  REQUIRE(frames.ok());
  drive.recording.frames = read_all(**frames);
  std::ifstream configuration(path + "/nilio.yaml");
  drive.configuration.assign(std::istreambuf_iterator<char>(configuration), {});
  REQUIRE(drive.recording.packets.size() > 50'000);
  REQUIRE(drive.recording.frames.size() > 10'000);
}

const SimulatedDrive& simulated() {
  static const auto drive = [] {
    auto made = std::make_unique<SimulatedDrive>();
    simulate(*made);
    return made;
  }();
  return *drive;
}

bool is_between(Duration time, double from_s, double to_s) {
  return time >= Duration::from_seconds(from_s) && time < Duration::from_seconds(to_s);
}

/// Time from the start of one round to the start of the next.
Duration period(const Recording& recording) {
  return recording.packets.back().stamp - recording.packets.front().stamp + kPause;
}

}  // namespace

const Recording& town_drive() { return simulated().recording; }
std::string town_folder() { return simulated().folder.path().string(); }
std::string town_configuration() { return simulated().configuration; }

Fate Faults::of_packet(std::size_t index, Duration since_start) const {
  if (!enabled) return Fate::kAsItIs;
  if (is_between(since_start, 20.0, 23.0)) return Fate::kLost;
  // Bursts of 30 packets per 1000.
  if (is_between(since_start, 25.0, 35.0) && index % 1000 < 30) return Fate::kLost;
  if (is_between(since_start, 36.0, 40.0) && index % 7 == 0) return Fate::kDamaged;
  if (is_between(since_start, 40.0, 42.0) && index % 5 == 0) return Fate::kWrongLength;
  if (is_between(since_start, 42.0, 44.0) && index % 5 == 0) return Fate::kTooLong;
  return Fate::kAsItIs;
}

bool Faults::is_frame_lost(Duration since_start) const {
  return enabled && (is_between(since_start, 46.0, 50.0) || is_between(since_start, 22.0, 24.0));
}

bool RepeatedPackets::next(drivers::Packet& slot) {
  while (round_ < times_) {
    if (index_ == recording_.packets.size()) {
      index_ = 0;
      ++round_;
      continue;
    }
    const drivers::Packet& packet = recording_.packets[index_];
    const Fate fate = faults_.of_packet(index_++, packet.stamp - recording_.packets.front().stamp);
    if (fate == Fate::kLost) continue;
    slot = packet;
    slot.stamp = slot.stamp + period(recording_) * static_cast<std::int64_t>(round_);
    // Block with a wrong flag, block with an impossible azimuth, and a packet of an unknown length.
    if (fate == Fate::kDamaged) {
      slot.data[100 * (index_ % 12)] ^= 0xFFU;
      slot.data[100 * (index_ % 11) + 3] = 0xFFU;
    }
    if (fate == Fate::kWrongLength) slot.size = static_cast<std::uint16_t>(index_ % drivers::kPacketCapacity);
    if (fate == Fate::kTooLong) slot.truncated = true;
    return true;
  }
  return false;
}

drivers::SourceRead RepeatedPackets::read(std::span<drivers::Packet> slots, Duration /*timeout*/) {
  std::size_t count = 0;
  while (count < slots.size() && next(slots[count])) ++count;
  if (speed_ > 0.0 && count > 0) {
    if (begun_ns_ == 0) begun_ns_ = monotonic_ns();
    const Duration since_start = slots[0].stamp - recording_.packets.front().stamp;
    const std::int64_t due_ns =
        begun_ns_ + static_cast<std::int64_t>(static_cast<double>(since_start.ns) / speed_);
    const std::int64_t left_ns = due_ns - monotonic_ns();
    const timespec pause{left_ns / 1'000'000'000, left_ns % 1'000'000'000};
    if (left_ns > 0) nanosleep(&pause, nullptr);
  }
  for (drivers::Packet& packet : slots.first(count)) packet.received_ns = monotonic_ns();
  return {count > 0 ? drivers::SourceState::kData : drivers::SourceState::kEnd, count};
}

bool RepeatedFrames::next(drivers::CanFrame& slot) {
  const core::Time start = recording_.packets.front().stamp;
  while (round_ < times_) {
    if (index_ == recording_.frames.size()) {
      index_ = 0;
      ++round_;
      continue;
    }
    const drivers::CanFrame& frame = recording_.frames[index_++];
    if (faults_.is_frame_lost(frame.stamp - start)) continue;
    slot = frame;
    slot.stamp = slot.stamp + period(recording_) * static_cast<std::int64_t>(round_);
    return true;
  }
  return false;
}

drivers::SourceRead RepeatedFrames::read(std::span<drivers::CanFrame> slots, Duration /*timeout*/) {
  std::size_t count = 0;
  while (count < slots.size() && next(slots[count])) ++count;
  return {count > 0 ? drivers::SourceState::kData : drivers::SourceState::kEnd, count};
}

}  // namespace nilio::tests
