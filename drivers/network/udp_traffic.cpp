#include "drivers/network/udp_traffic.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include "drivers/network/interfaces.hpp"

#include <algorithm>
#include <limits>

namespace nilio::drivers {
namespace {

std::string sender_text(std::uint32_t address, std::uint64_t count) {
  return std::to_string(count) + " from " + format_ipv4(address);
}

/// Largest value for a time of 0. The receive thread may have read its clock after this thread.
std::int64_t age_of(std::int64_t last_ns, std::int64_t now_ns) {
  return last_ns == 0 ? std::numeric_limits<std::int64_t>::max()
                      : std::max<std::int64_t>(now_ns - last_ns, 0);
}

}  // namespace

void UdpTraffic::on_accepted(const Packet& packet, std::size_t sent_bytes, const UdpSourceConfig& config) {
  const bool is_data = packet.destination_port == config.port;
  add_to(is_data ? data_packets_ : position_packets_, 1);
  if (is_data) {
    senders_.count(packet.sender_address);
    last_data_ns_.store(packet.received_ns, std::memory_order_relaxed);
  }
  // Without a port of their own, position packets share the data port, or it is theirs.
  const bool is_right = sent_bytes == (is_data ? kDataPacketSize : kPositionPacketSize) ||
                        (config.position_port == 0 && sent_bytes == kPositionPacketSize);
  if (!is_right) {
    wrong_sizes_.count({packet.destination_port, static_cast<std::uint16_t>(sent_bytes)});
  }
  last_ns_.store(packet.received_ns, std::memory_order_relaxed);
}

std::int64_t UdpTraffic::data_age_ns(std::int64_t now_ns) const {
  return age_of(last_data_ns_.load(std::memory_order_relaxed), now_ns);
}

std::string UdpTraffic::describe_packets(const UdpSourceConfig& config, std::int64_t now_ns) const {
  std::string text = std::to_string(data_packets_.load(std::memory_order_relaxed));
  if (config.position_port != 0) {
    text += " data and " + std::to_string(position_packets_.load(std::memory_order_relaxed)) + " position";
  }
  text += " packets";
  const std::int64_t age = age_of(last_ns_.load(std::memory_order_relaxed), now_ns);
  if (age == std::numeric_limits<std::int64_t>::max()) return text;
  const std::int64_t tenths = age / 100'000'000;
  return text + ", the last " + std::to_string(tenths / 10) + "." + std::to_string(tenths % 10) + " s ago";
}

std::string UdpTraffic::describe_problems(const UdpSourceConfig& config) const {
  std::string text;
  const std::string others = other_senders_.describe(sender_text);
  if (!others.empty())
    text += "; ignored " + others + ", since only " + config.sender_address + " is accepted";
  if (senders_.keys() > 1) {
    text += "; packets of several sensors are mixed (" + senders_.describe(sender_text) +
            "): set the sender address to the one wanted";
  }
  const std::string sizes = wrong_sizes_.describe([](const PortAndSize& key, std::uint64_t count) {
    return std::to_string(count) + " of " + std::to_string(key.size) + " bytes to port " +
           std::to_string(key.port);
  });
  if (!sizes.empty()) {
    text += "; not a Velodyne's: " + sizes + " (data packets have 1206 bytes, position packets 512)";
  }
  const bool position_only = data_packets_.load(std::memory_order_relaxed) == 0 &&
                             position_packets_.load(std::memory_order_relaxed) > 0;
  if (position_only) {
    text +=
        "; position packets arrive, data does not: set the LiDAR's port to the data port in the sensor's "
        "web page, and check that the laser is on";
  }
  return text;
}

}  // namespace nilio::drivers
