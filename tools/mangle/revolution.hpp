#pragma once

#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/velodyne/model.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/mangle/return_faults.hpp"

#include <cstdint>
#include <optional>
#include <vector>

namespace nilio::tools::mangle {

/// Changes the returns in the packets of one revolution. One thread.
class RevolutionEditor {
 public:
  /// `layout` is that of the return mode of all packets.
  RevolutionEditor(const drivers::VelodyneSensor& sensor, const drivers::PacketLayout& layout,
                   const Faults& faults);

  /// Packets that are no data packets stay as they are.
  void edit(std::vector<drivers::Packet>& packets, std::uint64_t number);
  [[nodiscard]] const ReturnCounts& counts() const { return faults_.counts(); }

 private:
  /// A return and its place.
  struct Place {
    std::size_t packet;
    std::size_t block;
    std::size_t entry;
  };
  void collect(const drivers::VelodyneDataPacket& data, std::size_t packet);

  drivers::VelodyneSensor sensor_;
  drivers::PacketLayout layout_;
  ReturnFaults faults_;
  std::vector<Return> returns_;
  std::vector<Place> places_;
  std::vector<EditedReturn> edits_;
  std::vector<std::optional<drivers::VelodyneDataPacket>> decoded_;
};

/// Divides packets into revolutions at the packet in which the azimuth passes the rear, and drops or edits
/// whole revolutions. One thread.
class Revolutions {
 public:
  /// Every `drop`-th revolution is dropped; 0 = none. `editor` may be null, and then packets are not held
  /// back unless revolutions are dropped.
  Revolutions(unsigned drop, RevolutionEditor* editor) : drop_(drop), editor_(editor) {}

  void add(const drivers::Packet& packet, std::vector<drivers::Packet>& out);
  void finish(std::vector<drivers::Packet>& out);
  [[nodiscard]] std::uint64_t packets() const { return packets_; }
  [[nodiscard]] std::uint64_t revolutions() const { return revolutions_; }
  [[nodiscard]] std::uint64_t dropped() const { return dropped_; }

 private:
  [[nodiscard]] bool passes_rear(const drivers::Packet& packet);

  unsigned drop_;
  RevolutionEditor* editor_;
  std::vector<drivers::Packet> open_;
  int last_azimuth_ = -1;
  std::uint64_t packets_ = 0;
  std::uint64_t revolutions_ = 0;
  std::uint64_t dropped_ = 0;
};

}  // namespace nilio::tools::mangle
