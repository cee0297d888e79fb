#include "tools/inspect/capture_file.hpp"

#include "nilio/drivers/network/udp_in_frame.hpp"

#include <algorithm>
#include <utility>

namespace nilio::tools {

namespace {

using drivers::CapturedDatagram;
using drivers::CaptureRead;

/// The year 2100: pcapng can hold stamps that make no sense as nanoseconds.
constexpr std::int64_t kLatestStampNs = 4'102'444'800'000'000'000;

RecordKind take_datagram(const CapturedDatagram& datagram, CaptureRecord& record) {
  drivers::Packet& packet = record.packet;
  packet.sender_address = datagram.source_address;
  packet.sender_port = datagram.source_port;
  packet.destination_port = datagram.destination_port;
  packet.truncated = datagram.payload.size() > packet.data.size();
  packet.size = static_cast<std::uint16_t>(std::min(datagram.payload.size(), packet.data.size()));
  std::copy_n(datagram.payload.begin(), packet.size, packet.data.begin());
  record.payload_size = datagram.payload_size;
  return datagram.payload_is_cut ? RecordKind::kUdpCut : RecordKind::kUdp;
}

RecordKind read_frame(const drivers::CapturedFrame& frame, CaptureRecord& record) {
  if (frame.stamp_ns < 0 || frame.stamp_ns > kLatestStampNs) return RecordKind::kMalformed;
  record.packet.stamp.ns = frame.stamp_ns;
  const CapturedDatagram datagram = drivers::find_datagram(frame.link_type, frame.bytes);
  switch (datagram.kind) {
    case CapturedDatagram::Kind::kUdp:
      // A payload that ends early although the whole frame was kept contradicts its own header.
      return datagram.payload_is_cut && !frame.is_cut ? RecordKind::kMalformed
                                                      : take_datagram(datagram, record);
    case CapturedDatagram::Kind::kFragment:
      return RecordKind::kFragment;
    case CapturedDatagram::Kind::kOther:
      return RecordKind::kOtherIp;
    case CapturedDatagram::Kind::kNotIpv4:
      return RecordKind::kNotIpv4;
    case CapturedDatagram::Kind::kMalformed:
      break;
  }
  return RecordKind::kMalformed;
}

}  // namespace

core::Result<CaptureFile> CaptureFile::open(const std::string& path) {
  auto reader = drivers::open_capture(path);
  if (!reader) return reader.error();
  CaptureFile file;
  file.reader_ = std::move(reader).value();
  return file;
}

bool CaptureFile::next(CaptureRecord& record) {
  if (!reader_) return false;
  drivers::CapturedFrame frame;
  const CaptureRead read = reader_->next(frame);
  if (read == CaptureRead::kFrame || read == CaptureRead::kSkipped) {
    record.kind = read == CaptureRead::kFrame ? read_frame(frame, record) : RecordKind::kMalformed;
    return true;
  }
  if (read == CaptureRead::kTruncated) {
    early_end_ =
        "the file ends in the middle of a record (recording not closed properly, or copied in part); "
        "everything "
        "before was read";
  } else if (read == CaptureRead::kDamaged) {
    early_end_ = "the file is damaged (" + reader_->problem() + "); everything before was read";
  }
  reader_.reset();
  return false;
}

}  // namespace nilio::tools
