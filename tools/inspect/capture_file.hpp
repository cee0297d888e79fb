#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstdint>
#include <memory>
#include <string>

namespace nilio::tools {

/// What a record of a capture is, as far as its headers tell.
enum class RecordKind : std::uint8_t {
  kUdp,       ///< a whole IPv4 UDP datagram
  kUdpCut,    ///< one of which bytes were not recorded (snap length)
  kFragment,  ///< a piece of a larger IPv4 packet
  kOtherIp,   ///< IPv4, but not UDP
  kNotIpv4,   ///< ARP, IPv6 ...
  kMalformed,
};

struct CaptureRecord {
  RecordKind kind = RecordKind::kMalformed;
  /// Bytes of the UDP payload by the UDP header; `packet` holds at most its capacity of them.
  std::uint16_t payload_size = 0;
  /// Addresses and ports are set for UDP only, the stamp for all but malformed records.
  drivers::Packet packet;
};

/// Every record of a capture. drivers::open_pcap() gives those of two ports and counts the rest; what is in
/// an unknown capture takes all ports, and why the others are of no use. One thread.
class CaptureFile {
 public:
  /// Takes what drivers::open_pcap() takes, and fails as it does.
  static core::Result<CaptureFile> open(const std::string& path);
  /// False at the end.
  bool next(CaptureRecord& record);
  /// Why the end came before that of the recording, for people; empty where it did not.
  [[nodiscard]] const std::string& early_end() const { return early_end_; }

 private:
  CaptureFile() = default;

  /// Null after the end.
  std::unique_ptr<drivers::CaptureReader> reader_;
  std::string early_end_;
};

}  // namespace nilio::tools
