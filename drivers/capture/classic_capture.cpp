#include "nilio/core/units.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"

#include <array>
#include <cstring>
#include <optional>

#include <pcap/pcap.h>

namespace nilio::drivers {
namespace {

struct PcapCloser {
  void operator()(pcap_t* capture) const { pcap_close(capture); }
};
using PcapHandle = std::unique_ptr<pcap_t, PcapCloser>;

class ClassicCapture final : public CaptureReader {
 public:
  explicit ClassicCapture(PcapHandle capture)
      : capture_(std::move(capture)), link_type_(pcap_datalink(capture_.get())) {}

  CaptureRead next(CapturedFrame& frame) override {
    pcap_pkthdr* header = nullptr;
    const std::uint8_t* bytes = nullptr;
    const int result = pcap_next_ex(capture_.get(), &header, &bytes);
    if (result == PCAP_ERROR_BREAK) return CaptureRead::kEnd;
    if (result != 1) {
      const bool truncated = std::strstr(pcap_geterr(capture_.get()), "truncated") != nullptr;
      return truncated ? CaptureRead::kTruncated : CaptureRead::kDamaged;
    }
    frame.link_type = link_type_;
    // The capture was opened with nanosecond precision: tv_usec holds nanoseconds.
    frame.stamp_ns =
        static_cast<std::int64_t>(header->ts.tv_sec) * kNanosecondsPerSecond + header->ts.tv_usec;
    frame.bytes = {bytes, header->caplen};
    frame.is_cut = header->caplen < header->len;
    return CaptureRead::kFrame;
  }
  [[nodiscard]] std::string problem() const override { return pcap_geterr(capture_.get()); }

 private:
  PcapHandle capture_;
  int link_type_;
};

/// Error unless frames of this link type can carry the content.
std::optional<core::Error> check_link_type(int link_type, CaptureContent content) {
  const std::string beginning = "is a capture of link type " + link_type_name(link_type);
  if (content == CaptureContent::kUdp && !is_known_link_type(link_type)) {
    return core::Error{beginning +
                       ", which carries no Velodyne packets that can be read; record on an Ethernet "
                       "interface or with '-i any'"};
  }
  if (content == CaptureContent::kCan && !may_carry_can(link_type)) {
    return core::Error{beginning +
                       ", which carries no CAN frames; record on the CAN interface or with '-i any'"};
  }
  return std::nullopt;
}

}  // namespace

std::string link_type_name(int link_type) {
  const char* name = pcap_datalink_val_to_name(link_type);
  return name != nullptr ? name : std::to_string(link_type);
}

core::Result<std::unique_ptr<CaptureReader>> open_classic_capture(FileHandle file, CaptureContent content) {
  std::array<char, PCAP_ERRBUF_SIZE> message{};
  PcapHandle capture(
      pcap_fopen_offline_with_tstamp_precision(file.get(), PCAP_TSTAMP_PRECISION_NANO, message.data()));
  if (!capture) {
    return core::Error{std::string("is no capture (") + message.data() +
                       "); expected pcap or pcapng as tcpdump or Wireshark write them, uncompressed"};
  }
  // libpcap owns the file from here on.
  static_cast<void>(file.release());
  if (auto problem = check_link_type(pcap_datalink(capture.get()), content)) return *problem;
  return std::unique_ptr<CaptureReader>(std::make_unique<ClassicCapture>(std::move(capture)));
}

}  // namespace nilio::drivers
