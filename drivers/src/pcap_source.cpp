#include "nilio/drivers/pcap.hpp"

#include "source_support.hpp"
#include "udp_in_frame.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>

#include <pcap/pcap.h>

namespace nilio::drivers {
namespace {

using core::Error;

struct PcapCloser {
  void operator()(pcap_t* capture) const { pcap_close(capture); }
};
using PcapHandle = std::unique_ptr<pcap_t, PcapCloser>;

/// How many datagrams went to which other ports; the rarest are not told apart when there are many.
class PortCounter {
 public:
  void count(std::uint16_t port) {
    const std::lock_guard lock(mutex_);
    for (Entry& entry : entries_) {
      if (entry.count != 0 && entry.port != port) continue;
      entry.port = port;
      ++entry.count;
      return;
    }
    ++further_;
  }

  [[nodiscard]] std::string describe() const {
    const std::lock_guard lock(mutex_);
    std::array<Entry, kPorts> sorted = entries_;
    std::stable_sort(sorted.begin(), sorted.end(),
                     [](const Entry& a, const Entry& b) { return a.count > b.count; });
    std::string text;
    for (const Entry& entry : sorted) {
      if (entry.count == 0) break;
      text +=
          (text.empty() ? "" : ", ") + std::to_string(entry.count) + " to port " + std::to_string(entry.port);
    }
    if (further_ > 0) text += ", " + std::to_string(further_) + " to further ports";
    return text;
  }

 private:
  static constexpr std::size_t kPorts = 12;
  struct Entry {
    std::uint16_t port = 0;
    std::uint64_t count = 0;
  };
  mutable std::mutex mutex_;
  std::array<Entry, kPorts> entries_{};
  std::uint64_t further_ = 0;
};

class PcapSource final : public PacketSource {
 public:
  PcapSource(PcapHandle capture, std::string path, const PcapSourceConfig& config)
      : capture_(std::move(capture)),
        path_(std::move(path)),
        config_(config),
        link_type_(pcap_datalink(capture_.get())) {}

  SourceRead read(std::span<Packet> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  bool accept(const pcap_pkthdr& header, const std::uint8_t* bytes, Packet& slot);
  void end(const char* reason);

  PcapHandle capture_;
  const std::string path_;
  const PcapSourceConfig config_;
  const int link_type_;
  SourceCounters counters_;
  PortCounter other_ports_;
  std::atomic<SourceState> state_{SourceState::kData};
  /// Why it ended before the end of the file; written once, before `state_`.
  mutable std::mutex end_mutex_;
  std::string end_reason_;
};

SourceRead PcapSource::read(std::span<Packet> slots, core::Duration /*timeout*/) {
  std::size_t count = 0;
  while (count < slots.size() && state_.load(std::memory_order_relaxed) == SourceState::kData) {
    pcap_pkthdr* header = nullptr;
    const std::uint8_t* bytes = nullptr;
    const int result = pcap_next_ex(capture_.get(), &header, &bytes);
    if (result == 1) {
      if (accept(*header, bytes, slots[count])) ++count;
    } else {
      end(result == PCAP_ERROR_BREAK ? nullptr : pcap_geterr(capture_.get()));
    }
  }
  counters_.add_delivered(count);
  if (count > 0 || slots.empty()) return {SourceState::kData, count};
  return {state_.load(std::memory_order_relaxed), 0};
}

bool PcapSource::accept(const pcap_pkthdr& header, const std::uint8_t* bytes, Packet& slot) {
  const CapturedDatagram datagram = find_datagram(link_type_, {bytes, header.caplen});
  if (datagram.kind == CapturedDatagram::Kind::kMalformed) counters_.add_malformed(1);
  if (datagram.kind == CapturedDatagram::Kind::kOther) counters_.add_other(1);
  if (datagram.kind != CapturedDatagram::Kind::kUdp) return false;
  if (datagram.destination_port != config_.data_port && datagram.destination_port != config_.position_port) {
    counters_.add_other(1);
    other_ports_.count(datagram.destination_port);
    return false;
  }
  // The capture was opened with nanoseconds, so tv_usec counts those.
  slot.stamp.ns = static_cast<std::int64_t>(header.ts.tv_sec) * 1'000'000'000 + header.ts.tv_usec;
  slot.received_ns = clock_ns(CLOCK_MONOTONIC);
  slot.sender_address = datagram.source_address;
  slot.sender_port = datagram.source_port;
  slot.destination_port = datagram.destination_port;
  slot.truncated = datagram.payload.size() > slot.data.size();
  slot.size = static_cast<std::uint16_t>(std::min(datagram.payload.size(), slot.data.size()));
  std::copy_n(datagram.payload.begin(), slot.size, slot.data.begin());
  return true;
}

/// `reason` as libpcap tells it, or null at the regular end.
void PcapSource::end(const char* reason) {
  if (reason == nullptr) {
    state_.store(SourceState::kEnd, std::memory_order_relaxed);
    return;
  }
  const std::lock_guard lock(end_mutex_);
  end_reason_ = reason;
  const bool cut_off = end_reason_.find("truncated") != std::string::npos;
  if (cut_off) {
    counters_.add_malformed(1);
    end_reason_ =
        "the file ends in the middle of a packet (recording not closed properly, or copied in part); "
        "everything before was read";
  }
  state_.store(cut_off ? SourceState::kEnd : SourceState::kFailed, std::memory_order_relaxed);
}

std::string PcapSource::status() const {
  const SourceStats stats = counters_.read();
  const std::string others = other_ports_.describe();
  std::string text = path_ + ": " + std::to_string(stats.delivered) + " packets to UDP ports " +
                     std::to_string(config_.data_port) + " and " + std::to_string(config_.position_port);
  if (!others.empty()) text += "; also " + others;
  if (stats.malformed > 0) text += "; " + std::to_string(stats.malformed) + " malformed";
  const SourceState state = state_.load(std::memory_order_relaxed);
  if (state == SourceState::kEnd && stats.delivered == 0) {
    text += others.empty() ? "; it has no UDP packets over IPv4, record with 'tcpdump -w FILE udp port " +
                                 std::to_string(config_.data_port) + "'"
                           : "; set the LiDAR's port to the one it was recorded on";
  }
  const std::lock_guard lock(end_mutex_);
  return end_reason_.empty() ? text : text + "; " + end_reason_;
}

/// What is wrong with the file before libpcap sees it, whose messages do not say what to do.
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

core::Result<std::unique_ptr<PacketSource>> open_pcap(const std::string& path,
                                                      const PcapSourceConfig& config) {
  if (auto problem = check_file(path)) return *problem;
  std::array<char, PCAP_ERRBUF_SIZE> message{};
  PcapHandle capture(
      pcap_open_offline_with_tstamp_precision(path.c_str(), PCAP_TSTAMP_PRECISION_NANO, message.data()));
  if (!capture) {
    return Error{path + ": is no capture that can be read (" + message.data() +
                 "); expected pcap or pcapng as tcpdump or Wireshark write them, uncompressed"};
  }
  const int link_type = pcap_datalink(capture.get());
  if (!is_known_link_type(link_type)) {
    const char* name = pcap_datalink_val_to_name(link_type);
    return Error{path + ": is a capture of link type " +
                 (name != nullptr ? name : std::to_string(link_type)) +
                 ", which carries no Velodyne packets that can be read; record on an Ethernet interface or "
                 "with '-i any'"};
  }
  return std::unique_ptr<PacketSource>(std::make_unique<PcapSource>(std::move(capture), path, config));
}

}  // namespace nilio::drivers
