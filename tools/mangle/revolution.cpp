#include "tools/mangle/revolution.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <span>
#include <utility>

namespace nilio::tools::mangle {

namespace {

constexpr int kRearAzimuth = drivers::kAzimuthModulus / 2;
constexpr double kRadiansPerStep = 2.0 * std::numbers::pi / drivers::kAzimuthModulus;

bool has_distances(drivers::BlockContent content) {
  return content != drivers::BlockContent::kConfidence && content != drivers::BlockContent::kPadding;
}

/// Position in the sensor's ROS frame, accurate to centimetres: enough to choose returns.
Eigen::Vector3f position_of(const drivers::LaserCalibration& laser, int azimuth, double range_m) {
  const double angle = azimuth * kRadiansPerStep - laser.azimuth_correction_rad;
  const double horizontal = range_m * std::cos(laser.elevation_rad);
  return Eigen::Vector3d(horizontal * std::cos(angle), -horizontal * std::sin(angle),
                         range_m * std::sin(laser.elevation_rad))
      .cast<float>();
}

}  // namespace

RevolutionEditor::RevolutionEditor(const drivers::VelodyneSensor& sensor, const drivers::PacketLayout& layout,
                                   const Faults& faults)
    : sensor_(sensor), layout_(layout), faults_(faults, static_cast<unsigned>(sensor.lasers.size())) {}

void RevolutionEditor::collect(const drivers::VelodyneDataPacket& data, std::size_t packet) {
  for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b) {
    if (!has_distances(layout_.contents[b])) continue;
    for (std::size_t e = 0; e < drivers::kEntriesPerBlock; ++e) {
      const std::uint16_t distance = data.blocks[b].entries[e].distance;
      const std::size_t id = layout_.entries[b][e].laser;
      if (distance == 0 || id >= sensor_.lasers.size()) continue;
      const drivers::LaserCalibration& laser = sensor_.lasers[id];
      returns_.push_back(
          {position_of(laser, data.blocks[b].azimuth, distance * sensor_.distance_resolution_m), laser.ring});
      places_.push_back({packet, b, e});
    }
  }
}

void RevolutionEditor::edit(std::vector<drivers::Packet>& packets, std::uint64_t number) {
  returns_.clear();
  places_.clear();
  decoded_.assign(packets.size(), std::nullopt);
  for (std::size_t i = 0; i < packets.size(); ++i) {
    if (!drivers::is_data_packet(packets[i])) continue;
    decoded_[i] = drivers::decode(std::span(packets[i].data).first(packets[i].size));
    if (decoded_[i]) collect(*decoded_[i], i);
  }
  faults_.apply(returns_, number, edits_);
  for (std::size_t k = 0; k < places_.size(); ++k) {
    const Place& place = places_[k];
    auto& entry = decoded_[place.packet]->blocks[place.block].entries[place.entry];
    const double steps = std::round(edits_[k].range_m / sensor_.distance_resolution_m);
    entry.distance = static_cast<std::uint16_t>(std::clamp(steps, 0.0, 65535.0));
  }
  for (std::size_t i = 0; i < packets.size(); ++i) {
    if (!decoded_[i]) continue;
    const auto bytes = drivers::encode(*decoded_[i]);
    std::copy(bytes.begin(), bytes.end(), packets[i].data.begin());
  }
}

/// Whether the azimuth passes the rear before or within the packet.
bool Revolutions::passes_rear(const drivers::Packet& packet) {
  if (!drivers::is_data_packet(packet)) return false;
  // Little-endian azimuth of the first block.
  const int azimuth = packet.data[2] | (packet.data[3] << 8);
  if (azimuth >= drivers::kAzimuthModulus) return false;
  const int before = std::exchange(last_azimuth_, azimuth);
  if (before < 0) return false;
  const int advance = (azimuth - before + drivers::kAzimuthModulus) % drivers::kAzimuthModulus;
  const int to_rear = (kRearAzimuth - before + drivers::kAzimuthModulus) % drivers::kAzimuthModulus;
  // More than half a turn: an older packet arrived late.
  return advance < drivers::kAzimuthModulus / 2 && to_rear > 0 && to_rear <= advance;
}

void Revolutions::add(const drivers::Packet& packet, std::vector<drivers::Packet>& out) {
  ++packets_;
  if (passes_rear(packet)) finish(out);
  if (drop_ == 0 && editor_ == nullptr) {
    out.push_back(packet);
    return;
  }
  open_.push_back(packet);
}

void Revolutions::finish(std::vector<drivers::Packet>& out) {
  ++revolutions_;
  const bool is_dropped = drop_ > 0 && revolutions_ % drop_ == 0;
  if (is_dropped) ++dropped_;
  if (!is_dropped && editor_ != nullptr) editor_->edit(open_, revolutions_ - 1);
  if (!is_dropped) out.insert(out.end(), open_.begin(), open_.end());
  open_.clear();
}

}  // namespace nilio::tools::mangle
