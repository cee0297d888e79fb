#include "nilio/core/clock.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "drivers/capture/capture_source.hpp"
#include "drivers/network/interfaces.hpp"

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <optional>

namespace nilio::drivers {
namespace {

using core::Error;

class PcapSource final : public CaptureSource<Packet> {
 public:
  PcapSource(std::unique_ptr<CaptureReader> reader, std::string path, const PcapSourceConfig& config,
             std::uint32_t accepted_sender)
      : CaptureSource(std::move(reader), std::move(path)),
        config_(config),
        accepted_sender_(accepted_sender) {}

  [[nodiscard]] std::string status() const override;

 private:
  bool accept(const CapturedFrame& frame, Packet& slot) override;
  bool accept_datagram(const CapturedFrame& frame, const CapturedDatagram& datagram, Packet& slot);
  [[nodiscard]] std::string describe_rest(const SourceStats& stats) const;
  [[nodiscard]] std::string explain_nothing() const;

  const PcapSourceConfig config_;
  /// Host byte order; 0 = any.
  const std::uint32_t accepted_sender_;
  KeyCounter<std::uint16_t, 12> other_ports_;
  /// Senders of packets to the wanted ports.
  KeyCounter<std::uint32_t, 16> senders_;
  KeyCounter<int, 8> unread_link_types_;
  std::atomic<std::uint64_t> cut_packets_{0};
  std::atomic<std::uint64_t> fragments_{0};
};

bool PcapSource::accept(const CapturedFrame& frame, Packet& slot) {
  const CapturedDatagram datagram = find_datagram(frame.link_type, frame.bytes);
  switch (datagram.kind) {
    case CapturedDatagram::Kind::kUdp:
      return accept_datagram(frame, datagram, slot);
    case CapturedDatagram::Kind::kFragment:
      fragments_.fetch_add(1, std::memory_order_relaxed);
      counters_.add_other(1);
      return false;
    case CapturedDatagram::Kind::kOther:
    case CapturedDatagram::Kind::kNotIpv4:
      if (!is_known_link_type(frame.link_type)) unread_link_types_.count(frame.link_type);
      counters_.add_other(1);
      return false;
    case CapturedDatagram::Kind::kMalformed:
      break;
  }
  if (frame.is_cut) cut_packets_.fetch_add(1, std::memory_order_relaxed);
  counters_.add_malformed(1);
  return false;
}

bool PcapSource::accept_datagram(const CapturedFrame& frame, const CapturedDatagram& datagram, Packet& slot) {
  const std::uint16_t port = datagram.destination_port;
  if (port != config_.data_port && (port != config_.position_port || config_.position_port == 0)) {
    counters_.add_other(1);
    other_ports_.count(port);
    return false;
  }
  senders_.count(datagram.source_address);
  if (accepted_sender_ != 0 && datagram.source_address != accepted_sender_) {
    counters_.add_other(1);
    return false;
  }
  if (datagram.payload_is_cut && frame.is_cut) {
    cut_packets_.fetch_add(1, std::memory_order_relaxed);
    counters_.add_malformed(1);
    return false;
  }
  slot.stamp.ns = frame.stamp_ns;
  slot.received_ns = monotonic_ns();
  slot.sender_address = datagram.source_address;
  slot.sender_port = datagram.source_port;
  slot.destination_port = port;
  slot.truncated = datagram.payload.size() > slot.data.size();
  slot.size = static_cast<std::uint16_t>(std::min(datagram.payload.size(), slot.data.size()));
  std::copy_n(datagram.payload.begin(), slot.size, slot.data.begin());
  return true;
}

std::string PcapSource::status() const {
  const SourceStats stats = counters_.read();
  std::string text = path_ + ": " + std::to_string(stats.delivered) + " packets to UDP port" +
                     (config_.position_port == 0 ? " " : "s ") + std::to_string(config_.data_port) +
                     (config_.position_port == 0 ? "" : " and " + std::to_string(config_.position_port));
  text += describe_rest(stats);
  if (state() == SourceState::kEnd && stats.delivered == 0) text += "; " + explain_nothing();
  return with_end_reason(text);
}

/// Traffic other than the delivered packets; empty or beginning with "; ".
std::string PcapSource::describe_rest(const SourceStats& stats) const {
  std::string text;
  const std::string senders = senders_.describe([](std::uint32_t address, std::uint64_t count) {
    return std::to_string(count) + " from " + format_ipv4(address);
  });
  if (accepted_sender_ != 0 && !senders.empty()) {
    text += " (" + senders + "), of which only those from " + config_.sender_address + " are taken";
  } else if (senders_.keys() > 1) {
    text +=
        "; packets of several sensors are mixed (" + senders + "): set the sender address to the one wanted";
  }
  const std::string ports = other_ports_.describe([](std::uint16_t port, std::uint64_t count) {
    return std::to_string(count) + " to port " + std::to_string(port);
  });
  if (!ports.empty()) text += "; also " + ports;
  if (const auto fragments = fragments_.load(std::memory_order_relaxed); fragments > 0) {
    text += "; " + std::to_string(fragments) +
            " fragments of datagrams, which are left out: the network on the way has an MTU below 1500 bytes";
  }
  if (stats.malformed > 0) text += "; " + std::to_string(stats.malformed) + " malformed";
  if (const auto cut = cut_packets_.load(std::memory_order_relaxed); cut > 0) {
    text +=
        ", of which " + std::to_string(cut) + " were cut short by the recording: record with 'tcpdump -s 0'";
  }
  return text;
}

/// Cause and remedy when a whole capture delivered nothing.
std::string PcapSource::explain_nothing() const {
  if (senders_.keys() > 0 && accepted_sender_ != 0)
    return "set the sender address to one of these, or leave it empty";
  if (other_ports_.keys() > 0) return "set the LiDAR's port to the one it was recorded on";
  if (cut_packets_.load(std::memory_order_relaxed) > 0) return "no packet of it is usable";
  const std::string link_types = unread_link_types_.describe([](int type, std::uint64_t count) {
    return std::to_string(count) + " of link type " + link_type_name(type);
  });
  return (link_types.empty() ? "" : "it has " + link_types + "; ") +
         "it has no UDP packets over IPv4, record with 'tcpdump -w FILE udp port " +
         std::to_string(config_.data_port) + "'";
}

/// Error for a file that is missing, a folder or empty.
std::optional<Error> check_file(const std::string& path) {
  std::error_code code;
  const std::filesystem::file_status info = std::filesystem::status(path, code);
  if (!std::filesystem::exists(info)) return Error{path + ": there is no such file; check the path"};
  if (std::filesystem::is_directory(info)) return Error{path + ": is a folder; give a .pcap or .pcapng file"};
  if (std::filesystem::is_regular_file(info) && std::filesystem::file_size(path, code) == 0) {
    return Error{path + ": is empty (0 bytes); the recording was never written, record again"};
  }
  return std::nullopt;
}

}  // namespace

core::Result<std::unique_ptr<CaptureReader>> open_capture(const std::string& path, CaptureContent content) {
  if (auto problem = check_file(path)) return *problem;
  FileHandle file(std::fopen(path.c_str(), "rbe"));
  if (!file) {
    return Error{path + ": cannot be read (" + std::strerror(errno) + "); check its permissions"};
  }
  const int first = std::fgetc(file.get());
  std::ungetc(first, file.get());
  core::Result<std::unique_ptr<CaptureReader>> reader = first == kPcapngFirstByte
                                                            ? open_pcapng_capture(std::move(file))
                                                            : open_classic_capture(std::move(file), content);
  if (!reader) return Error{path + ": " + reader.error().message};
  return reader;
}

core::Result<std::unique_ptr<PacketSource>> open_pcap(const std::string& path,
                                                      const PcapSourceConfig& config) {
  const core::Result<std::uint32_t> sender = parse_optional_ipv4(config.sender_address, "sender");
  if (!sender) return Error{path + ": " + sender.error().message};
  core::Result<std::unique_ptr<CaptureReader>> reader = open_capture(path);
  if (!reader) return reader.error();
  return std::unique_ptr<PacketSource>(
      std::make_unique<PcapSource>(std::move(reader).value(), path, config, *sender));
}

}  // namespace nilio::drivers
