#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace nilio::drivers {

/// What to take from a capture; other traffic is counted, and its ports and senders are named in status().
struct PcapSourceConfig {
  std::uint16_t data_port = 2368;
  /// 0 = none.
  std::uint16_t position_port = 8308;
  /// Only datagrams of this sender, for captures of several sensors; empty = any.
  std::string sender_address{};
};

/// Opens a capture: pcap in any byte order and resolution, or pcapng, also with interfaces of different link
/// types; Ethernet and its VLAN tags, raw IP, loopback, and the cooked headers of 'tcpdump -i any' (SLL,
/// SLL2). Fails with what, where and what to do for files that are missing, empty or no capture. A capture
/// that ends in the middle of a record delivers what is whole, then ends, and status() says so. Packets that
/// the recording cut short are counted as malformed; fragments of datagrams are counted and left out.
core::Result<std::unique_ptr<PacketSource>> open_pcap(const std::string& path,
                                                      const PcapSourceConfig& config);

/// Writes UDP payloads as an Ethernet capture with nanosecond stamps.
class PcapWriter {
 public:
  static core::Result<PcapWriter> create(const std::string& path);
  PcapWriter(PcapWriter&&) noexcept;
  PcapWriter& operator=(PcapWriter&&) noexcept;
  PcapWriter(const PcapWriter&) = delete;
  PcapWriter& operator=(const PcapWriter&) = delete;
  ~PcapWriter();

  /// From 192.168.1.201 to the broadcast address, `port` to `port`. False when the disk is full, and for
  /// stamps before 1970 or after 2106 and payloads beyond UDP's 65507 bytes, which a capture cannot hold.
  bool write(core::Time stamp, std::uint16_t port, std::span<const std::uint8_t> payload);
  /// Flushes and reports whether all was written.
  bool close();

 private:
  struct State;
  explicit PcapWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace nilio::drivers
