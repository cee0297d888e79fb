#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>

namespace nilio::drivers {

/// Ports to take from a capture; other traffic is counted, and its ports are named in status().
struct PcapSourceConfig {
  std::uint16_t data_port = 2368;
  std::uint16_t position_port = 8308;
};

/// Opens a capture (pcap or pcapng as libpcap reads them; Ethernet with VLAN tags, raw IP, SLL, SLL2). Fails
/// with what, where and what to do for files that are missing, empty or no capture. A capture that ends in
/// the middle of a record delivers what is whole, then ends, and status() says so.
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
