#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Selects the packets of a capture. Other traffic is counted; status() names its ports and senders.
struct PcapSourceConfig {
  std::uint16_t data_port = 2368;
  /// 0 = none.
  std::uint16_t position_port = 8308;
  /// Only datagrams of this sender, for captures of several sensors; empty = any.
  std::string sender_address{};
};

/// Opens a capture: pcap in any byte order and resolution, or pcapng, also with interfaces of different link
/// types; Ethernet and its VLAN tags, raw IP, loopback, and the cooked headers of 'tcpdump -i any' (SLL,
/// SLL2). Fails for files that are missing, empty or no capture; the error names the file, the reason and the
/// remedy. A capture that ends in the middle of a record delivers the complete records, then ends; status()
/// reports it. Packets cut short by the recording count as malformed; fragments of datagrams are counted and
/// skipped.
core::Result<std::unique_ptr<PacketSource>> open_pcap(const std::string& path,
                                                      const PcapSourceConfig& config);

/// The files of one recording as one source. The next file is opened when one ends, so read() allocates at
/// every seam. A file that cannot be opened or read to its end is skipped, counted as malformed and named in
/// status(). Fails when there are no files or none can be opened. Counts are totals over all files so far.
core::Result<std::unique_ptr<PacketSource>> chain_captures(std::vector<std::string> paths,
                                                           const PcapSourceConfig& config);

/// Addresses and ports of a datagram, host byte order.
struct UdpEndpoints {
  std::uint32_t sender_address = 0;
  std::uint16_t sender_port = 0;
  std::uint32_t destination_address = 0xFFFFFFFF;
  std::uint16_t destination_port = 0;
};

/// Appends the file header of an Ethernet capture with nanosecond stamps.
void append_pcap_header(std::vector<std::uint8_t>& out);

/// Appends one UDP datagram. Returns false and appends nothing for stamps before 1970 or after 2106 and for
/// payloads above UDP's 65507 bytes, which a capture cannot hold.
bool append_pcap_record(std::vector<std::uint8_t>& out, core::Time stamp, const UdpEndpoints& endpoints,
                        std::span<const std::uint8_t> payload);

/// Appends a received packet with the sender's address and port and the destination port. Sockets do not
/// report the destination address; broadcast is written, the factory setting of the sensors. A packet longer
/// than its slot is marked as captured in part.
bool append_pcap_record(std::vector<std::uint8_t>& out, const Packet& packet);

/// Writes UDP payloads as an Ethernet capture with nanosecond stamps. One thread.
class PcapWriter {
 public:
  static core::Result<PcapWriter> create(const std::string& path);

  /// Writes a datagram from 192.168.1.201 to the broadcast address, `port` to `port`. False when the disk is
  /// full, and where append_pcap_record() returns false.
  bool write(core::Time stamp, std::uint16_t port, std::span<const std::uint8_t> payload);
  /// Flushes the file; returns whether everything was written.
  bool close();

 private:
  explicit PcapWriter(FileHandle file) : file_(std::move(file)) {}
  bool write_record();

  FileHandle file_;
  bool good_ = true;
  std::vector<std::uint8_t> record_;
};

}  // namespace nilio::drivers
