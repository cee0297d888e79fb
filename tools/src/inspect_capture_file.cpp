#include "inspect_capture_file.hpp"

#include "nilio/drivers/pcap.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <span>
#include <utility>

#include <pcap/pcap.h>

namespace nilio::tools {

namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr unsigned kEtherTypeIpv4 = 0x0800;
constexpr unsigned kEtherTypeVlan = 0x8100;
constexpr unsigned kEtherTypeProviderVlan = 0x88A8;
constexpr unsigned kFragmentMask = 0x3FFF;
constexpr std::uint8_t kProtocolUdp = 17;
constexpr std::size_t kLeastIpHeader = 20;
constexpr std::size_t kUdpHeader = 8;
/// The year 2100: pcapng can hold stamps that 64 bits of nanoseconds cannot.
constexpr std::int64_t kLatestSecond = 4'102'444'800;

unsigned load_be16(Bytes bytes, std::size_t at) {
  return static_cast<unsigned>(bytes[at] << 8) | bytes[at + 1];
}

std::uint32_t load_be32(Bytes bytes, std::size_t at) {
  return (static_cast<std::uint32_t>(load_be16(bytes, at)) << 16) | load_be16(bytes, at + 2);
}

/// Takes the link header off the front of `frame`; its protocol as an EtherType, nothing when it is cut.
std::optional<unsigned> take_link_header(int link_type, Bytes& frame) {
  std::size_t protocol_at = 12;
  std::size_t size = 14;
  if (link_type == DLT_RAW || link_type == DLT_IPV4) {
    if (frame.empty()) return std::nullopt;
    return frame[0] >> 4 == 4 ? kEtherTypeIpv4 : 0U;
  }
  if (link_type == DLT_LINUX_SLL) {
    protocol_at = 14;
    size = 16;
  } else if (link_type == DLT_LINUX_SLL2) {
    protocol_at = 0;
    size = 20;
  }
  if (frame.size() < size) return std::nullopt;
  unsigned protocol = load_be16(frame, protocol_at);
  frame = frame.subspan(size);
  while (protocol == kEtherTypeVlan || protocol == kEtherTypeProviderVlan) {
    if (frame.size() < 4) return std::nullopt;
    protocol = load_be16(frame, 2);
    frame = frame.subspan(4);
  }
  return protocol;
}

/// IP's total length is not used: some sensors send a wrong one. `cut`: the record is shorter than the frame
/// was.
RecordKind read_frame(int link_type, Bytes frame, bool cut, CaptureRecord& record) {
  const std::optional<unsigned> protocol = take_link_header(link_type, frame);
  if (!protocol) return RecordKind::kMalformed;
  if (*protocol != kEtherTypeIpv4) return RecordKind::kNotIpv4;
  if (frame.size() < kLeastIpHeader) return RecordKind::kMalformed;
  const std::size_t header = 4U * (frame[0] & 0x0FU);
  if (frame[0] >> 4 != 4 || header < kLeastIpHeader || frame.size() < header) return RecordKind::kMalformed;
  if ((load_be16(frame, 6) & kFragmentMask) != 0) return RecordKind::kFragment;
  if (frame[9] != kProtocolUdp) return RecordKind::kOtherIp;
  const Bytes udp = frame.subspan(header);
  if (udp.size() < kUdpHeader) return RecordKind::kMalformed;
  const std::size_t length = load_be16(udp, 4);
  if (length < kUdpHeader) return RecordKind::kMalformed;
  drivers::Packet& packet = record.packet;
  packet.sender_address = load_be32(frame, 12);
  packet.sender_port = static_cast<std::uint16_t>(load_be16(udp, 0));
  packet.destination_port = static_cast<std::uint16_t>(load_be16(udp, 2));
  record.payload_size = static_cast<std::uint16_t>(length - kUdpHeader);
  const Bytes payload = udp.subspan(kUdpHeader, std::min(length, udp.size()) - kUdpHeader);
  packet.truncated = payload.size() > packet.data.size();
  packet.size = static_cast<std::uint16_t>(std::min(payload.size(), packet.data.size()));
  std::copy_n(payload.begin(), packet.size, packet.data.begin());
  if (payload.size() == record.payload_size) return RecordKind::kUdp;
  return cut ? RecordKind::kUdpCut : RecordKind::kMalformed;
}

}  // namespace

struct CaptureFile::State {
  struct Closer {
    void operator()(pcap_t* handle) const { pcap_close(handle); }
  };
  std::unique_ptr<pcap_t, Closer> handle;
  int link_type = 0;
  bool ended = false;
  std::string early_end;
};

CaptureFile::CaptureFile(std::unique_ptr<State> state) : state_(std::move(state)) {}
CaptureFile::CaptureFile(CaptureFile&&) noexcept = default;
CaptureFile& CaptureFile::operator=(CaptureFile&&) noexcept = default;
CaptureFile::~CaptureFile() = default;

core::Result<CaptureFile> CaptureFile::open(const std::string& path) {
  // What is wrong with a file is said in one place.
  const auto readable = drivers::open_pcap(path, {});
  if (!readable) return readable.error();
  std::array<char, PCAP_ERRBUF_SIZE> message{};
  auto state = std::make_unique<State>();
  state->handle.reset(
      pcap_open_offline_with_tstamp_precision(path.c_str(), PCAP_TSTAMP_PRECISION_NANO, message.data()));
  if (!state->handle) return core::Error{path + ": cannot be opened (" + message.data() + ")"};
  state->link_type = pcap_datalink(state->handle.get());
  return CaptureFile(std::move(state));
}

bool CaptureFile::next(CaptureRecord& record) {
  if (state_->ended) return false;
  pcap_pkthdr* header = nullptr;
  const std::uint8_t* bytes = nullptr;
  const int result = pcap_next_ex(state_->handle.get(), &header, &bytes);
  if (result == 1) {
    // The capture was opened with nanoseconds, so tv_usec counts those.
    const auto seconds = static_cast<std::int64_t>(header->ts.tv_sec);
    if (seconds < 0 || seconds > kLatestSecond) {
      record.kind = RecordKind::kMalformed;
      return true;
    }
    record.packet.stamp.ns = seconds * 1'000'000'000 + header->ts.tv_usec;
    record.kind =
        read_frame(state_->link_type, Bytes(bytes, header->caplen), header->caplen < header->len, record);
    return true;
  }
  state_->ended = true;
  if (result == PCAP_ERROR_BREAK) return false;
  const std::string reason = pcap_geterr(state_->handle.get());
  state_->early_end =
      reason.find("truncated") != std::string::npos
          ? "the file ends in the middle of a record (recording not closed properly, or copied in "
            "part); everything before was read"
          : "the file is damaged (" + reason + "); everything before was read";
  return false;
}

const std::string& CaptureFile::early_end() const { return state_->early_end; }

}  // namespace nilio::tools
