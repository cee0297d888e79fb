#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace nilio::drivers {

/// A record of a capture file.
struct CapturedFrame {
  /// Value of libpcap's DLT_*.
  int link_type = 0;
  std::int64_t stamp_ns = 0;
  /// Captured part of the frame; valid until the next record is read.
  std::span<const std::uint8_t> bytes;
  /// The frame on the wire was longer.
  bool is_cut = false;
  /// Name of the network interface; empty where the file has none. Valid as long as the reader.
  std::string_view interface_name{};
  /// Byte order of the capturing machine. Known only from pcapng.
  bool big_endian_host = false;
};

enum class CaptureRead {
  kFrame,
  kSkipped,    ///< a malformed record; the next one may be good
  kEnd,        ///< regular end of the file
  kTruncated,  ///< the file ends in the middle of a record
  kDamaged,    ///< the position of further records is lost; problem() gives the reason
};

/// A capture file of one format. One thread. next() does not allocate once the largest frame was read.
class CaptureReader {
 public:
  CaptureReader() = default;
  CaptureReader(const CaptureReader&) = delete;
  CaptureReader& operator=(const CaptureReader&) = delete;
  virtual ~CaptureReader() = default;

  virtual CaptureRead next(CapturedFrame& frame) = 0;
  [[nodiscard]] virtual std::string problem() const = 0;
};

struct FileCloser {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, FileCloser>;

/// Wanted content of a capture: link types that cannot carry it are refused.
enum class CaptureContent { kUdp, kCan };

/// Opens a capture of either format, recognised by its first byte. Fails for files that are missing, empty or
/// no capture; the error names the file, the reason and the remedy.
core::Result<std::unique_ptr<CaptureReader>> open_capture(const std::string& path,
                                                          CaptureContent content = CaptureContent::kUdp);

/// Readers of the two formats. Both take a file at its beginning; their errors do not name it. pcapng has a
/// reader of its own, because libpcap refuses files whose interfaces have different link types.
core::Result<std::unique_ptr<CaptureReader>> open_classic_capture(FileHandle file, CaptureContent content);
core::Result<std::unique_ptr<CaptureReader>> open_pcapng_capture(FileHandle file);

/// First byte of pcapng files, which classic captures never begin with.
inline constexpr int kPcapngFirstByte = 0x0A;

/// "EN10MB" or the number.
std::string link_type_name(int link_type);

/// A UDP datagram found in a captured frame.
struct CapturedDatagram {
  enum class Kind {
    kUdp,
    kFragment,   ///< part of a UDP datagram
    kOther,      ///< IPv4, but not UDP
    kNotIpv4,    ///< ARP, IPv6, an unsupported link type ...
    kMalformed,  ///< headers that contradict themselves or end too early
  };
  Kind kind = Kind::kNotIpv4;
  /// Host byte order.
  std::uint32_t source_address = 0;
  std::uint16_t source_port = 0;
  std::uint16_t destination_port = 0;
  std::span<const std::uint8_t> payload;
  /// Payload size by the UDP header.
  std::uint16_t payload_size = 0;
  /// The frame ends before the payload does.
  bool payload_is_cut = false;
};

/// True for the link types that find_datagram() reads (values of libpcap's DLT_*).
bool is_known_link_type(int link_type);

/// Finds IPv4 UDP in a frame. Every length is checked against the captured bytes. IP's total length is
/// ignored, because some captures have it wrong.
CapturedDatagram find_datagram(int link_type, std::span<const std::uint8_t> frame);

/// A CAN frame found in a captured frame.
struct CapturedCan {
  enum class Kind {
    kCan,
    kOther,      ///< not CAN
    kMalformed,  ///< CAN, but cut short or with an invalid length
  };
  Kind kind = Kind::kOther;
  /// Without its stamps.
  CanFrame frame;
  /// Interface number in the cooked header of 'tcpdump -i any'; 0 where there is none.
  std::uint32_t interface_index = 0;
};

/// True for the link types of CAN frames: SocketCAN, and cooked (values of libpcap's DLT_*).
bool may_carry_can(int link_type);
/// True for the cooked link types, whose captures hold frames of many interfaces.
bool is_cooked_link_type(int link_type);

/// Finds a CAN frame. `big_endian_host`: byte order of the capturing machine, in which cooked captures store
/// the identifier.
CapturedCan find_can_frame(int link_type, std::span<const std::uint8_t> bytes, bool big_endian_host);

}  // namespace nilio::drivers
