#include "tools/inspect/capture.hpp"

#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/packet.hpp"

#include "tools/common/progress.hpp"
#include "tools/common/text.hpp"

#include <algorithm>
#include <cstdint>
#include <memory>
#include <string_view>
#include <tuple>
#include <utility>

namespace nilio::tools::inspect {

namespace {

/// Kind of a capture's record according to its headers.
enum class RecordKind : std::uint8_t {
  kUdp,       ///< a whole IPv4 UDP datagram
  kUdpCut,    ///< a truncated one (snap length)
  kFragment,  ///< a piece of a larger IPv4 packet
  kOtherIp,   ///< IPv4, but not UDP
  kNotIpv4,   ///< ARP, IPv6 ...
  kMalformed,
};

struct CaptureRecord {
  RecordKind kind = RecordKind::kMalformed;
  /// Size of the UDP payload according to its header; `packet` holds at most its capacity of it.
  std::uint16_t payload_size = 0;
  /// Addresses and ports are set for UDP only, the stamp for all but malformed records.
  drivers::Packet packet;
};

/// Reads every record of a capture, of all ports and kinds; drivers::open_pcap() delivers only two ports. One
/// thread.
class CaptureFile {
 public:
  /// Accepts the formats of drivers::open_pcap(), and fails as it does.
  static core::Result<CaptureFile> open(const std::string& path);
  /// False at the end.
  bool next(CaptureRecord& record);
  /// Reason of an early end, for people; empty if there was none.
  [[nodiscard]] const std::string& early_end() const { return early_end_; }

 private:
  CaptureFile() = default;

  /// Null after the end.
  std::unique_ptr<drivers::CaptureReader> reader_;
  std::string early_end_;
};

using drivers::CapturedDatagram;
using drivers::CaptureRead;

/// The year 2100: pcapng can hold stamps that are no valid nanoseconds.
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
      // A payload that ends early in a complete frame contradicts its header.
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

constexpr std::uint64_t kRecordsPerUpdate = 4096;
constexpr std::size_t kMaximumSensors = 32;
constexpr std::size_t kMaximumStreams = 256;
constexpr std::uint16_t kUsualTelemetryPort = 8308;
constexpr std::size_t kNmeaOffset = 0xCE;

/// Data packets of all models begin with this block flag.
bool looks_like_data(const CaptureRecord& record) {
  return record.payload_size == drivers::kDataPacketSize && record.packet.data[0] == 0xFF &&
         record.packet.data[1] == 0xEE;
}

bool looks_like_telemetry(const CaptureRecord& record) {
  return record.payload_size == drivers::kPositionPacketSize &&
         (record.packet.destination_port == kUsualTelemetryPort || record.packet.data[kNmeaOffset] == '$');
}

class CaptureInspector {
 public:
  explicit CaptureInspector(const std::string& path) { findings_.path = path; }

  void add(const CaptureRecord& record) {
    const core::Time stamp = record.packet.stamp;
    ++findings_.records;
    ++counter(record.kind);
    // The stamp of a damaged record may be damaged, too.
    if (record.kind == RecordKind::kMalformed) return;
    if (!timed_) findings_.first = findings_.last = stamp;
    timed_ = true;
    findings_.first = std::min(findings_.first, stamp);
    findings_.last = std::max(findings_.last, stamp);
    if (record.kind == RecordKind::kUdp || record.kind == RecordKind::kUdpCut) add_datagram(record);
  }

  CaptureFindings finish(const std::string& early_end) {
    findings_.early_end = early_end;
    for (auto& [key, stream] : streams_) findings_.streams.push_back(stream);
    for (auto& [key, sensor] : sensors_) {
      findings_.sensors.push_back(sensor.finish());
      // Telemetry of a sender with several data streams belongs to the first.
      const auto telemetry = telemetry_.find(key.first);
      if (telemetry == telemetry_.end()) continue;
      findings_.sensors.back().telemetry = telemetry->second.finish();
      telemetry_.erase(telemetry);
    }
    for (auto& [address, telemetry] : telemetry_)
      findings_.lone_telemetry.emplace(address, telemetry.finish());
    return std::move(findings_);
  }

 private:
  using StreamKey = std::tuple<std::uint32_t, std::uint16_t, std::uint16_t>;
  /// Sender's address and destination port.
  using SensorKey = std::pair<std::uint32_t, std::uint16_t>;

  std::uint64_t& counter(RecordKind kind) {
    switch (kind) {
      case RecordKind::kUdp:
        return findings_.udp;
      case RecordKind::kUdpCut:
        return findings_.cut;
      case RecordKind::kFragment:
        return findings_.fragments;
      case RecordKind::kOtherIp:
        return findings_.other_ip;
      case RecordKind::kNotIpv4:
        return findings_.not_ipv4;
      case RecordKind::kMalformed:
        break;
    }
    return findings_.malformed;
  }

  void add_datagram(const CaptureRecord& record) {
    const drivers::Packet& packet = record.packet;
    StreamContent content = StreamContent::kOther;
    if (record.kind == RecordKind::kUdp) content = add_to_sensor(record);
    const StreamKey key{packet.sender_address, packet.sender_port, packet.destination_port};
    const auto known = streams_.find(key);
    if (known == streams_.end() && streams_.size() == kMaximumStreams) {
      ++findings_.further_streams;
      return;
    }
    StreamFindings& stream = known != streams_.end() ? known->second : streams_[key];
    if (stream.packets++ == 0) {
      std::tie(stream.address, stream.sender_port, stream.destination_port) = key;
      stream.smallest = stream.largest = record.payload_size;
    }
    if (content != StreamContent::kOther) stream.content = content;
    stream.bytes += record.payload_size;
    stream.smallest = std::min(stream.smallest, record.payload_size);
    stream.largest = std::max(stream.largest, record.payload_size);
  }

  StreamContent add_to_sensor(const CaptureRecord& record) {
    const drivers::Packet& packet = record.packet;
    if (looks_like_telemetry(record)) {
      if (telemetry_.size() < kMaximumSensors || telemetry_.contains(packet.sender_address))
        telemetry_[packet.sender_address].add(packet);
      for (auto& [key, sensor] : sensors_) {
        if (key.first == packet.sender_address) sensor.add_telemetry(packet);
      }
      return StreamContent::kTelemetry;
    }
    const SensorKey key{packet.sender_address, packet.destination_port};
    auto sensor = sensors_.find(key);
    if (sensor == sensors_.end()) {
      if (!looks_like_data(record) || sensors_.size() == kMaximumSensors) return StreamContent::kOther;
      sensor = sensors_.emplace(key, SensorInspector(key.first, key.second)).first;
    }
    sensor->second.add_data(packet);
    return StreamContent::kData;
  }

  CaptureFindings findings_;
  bool timed_ = false;
  std::map<StreamKey, StreamFindings> streams_;
  std::map<SensorKey, SensorInspector> sensors_;
  std::map<std::uint32_t, TelemetryInspector> telemetry_;
};

/// "12 to port 5353, ...", in descending order.
std::string ports_text(const CaptureFindings& capture) {
  constexpr std::size_t kShown = 5;
  std::map<std::uint16_t, std::uint64_t> ports;
  for (const StreamFindings& stream : capture.streams) ports[stream.destination_port] += stream.packets;
  std::vector<std::pair<std::uint64_t, std::uint16_t>> sorted;
  for (const auto& [port, count] : ports) sorted.emplace_back(count, port);
  std::sort(sorted.rbegin(), sorted.rend());
  std::string text;
  for (std::size_t i = 0; i < std::min(kShown, sorted.size()); ++i) {
    text += format("%s%llu to port %u", i == 0 ? "" : ", ", static_cast<unsigned long long>(sorted[i].first),
                   sorted[i].second);
  }
  return sorted.size() > kShown ? text + ", ..." : text;
}

}  // namespace

bool CaptureFindings::usable() const {
  return std::any_of(sensors.begin(), sensors.end(), [](const SensorFindings& s) { return s.usable(); });
}

core::Result<CaptureFindings> inspect_capture(const std::string& path) {
  core::Result<CaptureFile> file = CaptureFile::open(path);
  if (!file) return file.error();
  CaptureInspector inspector(path);
  CaptureRecord record;
  Progress progress(path + ", records read");
  for (std::uint64_t records = 0; file->next(record); ++records) {
    inspector.add(record);
    if (records % kRecordsPerUpdate == 0) progress.update(records);
  }
  return inspector.finish(file->early_end());
}

std::string why_unusable(const CaptureFindings& capture) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  const std::string advice =
      "record with 'tcpdump -i INTERFACE -w FILE udp' where the sensor's packets arrive";
  if (!capture.sensors.empty()) {
    const SensorFindings& sensor = capture.sensors.front();
    if (!sensor.model)
      return format("%s: data packets of no known model (%s): only Velodyne's are read", capture.path.c_str(),
                    sensor.detection.evidence.c_str());
    return format(
        "%s: %llu packets of a %s without a single return: is something in front of the sensor, or is its "
        "laser off?",
        capture.path.c_str(), count(sensor.packets),
        std::string(drivers::velodyne_model_name(*sensor.model)).c_str());
  }
  if (capture.records == 0)
    return capture.path + ": a capture without packets" +
           (capture.early_end.empty() ? "" : " (" + capture.early_end + ")") + "; " + advice;
  if (capture.cut > 0)
    return format(
        "%s: %llu datagrams were recorded in part only (snap length); record again without tcpdump's option "
        "-s, or with '-s 0'",
        capture.path.c_str(), count(capture.cut));
  if (capture.udp == 0)
    return format(
        "%s: no UDP over IPv4 (%llu other IPv4 packets, %llu that are not IPv4, %llu fragments, %llu "
        "malformed records); %s",
        capture.path.c_str(), count(capture.other_ip), count(capture.not_ipv4), count(capture.fragments),
        count(capture.malformed), advice.c_str());
  if (!capture.lone_telemetry.empty())
    return format(
        "%s: telemetry of %s, but no data packets of %zu bytes (%s); record all of the sensor's UDP traffic",
        capture.path.c_str(), address_text(capture.lone_telemetry.begin()->first).c_str(),
        drivers::kDataPacketSize, ports_text(capture).c_str());
  return format("%s: no Velodyne packets (%zu bytes that begin with FF EE) among %llu UDP datagrams: %s; %s",
                capture.path.c_str(), drivers::kDataPacketSize, count(capture.udp),
                ports_text(capture).c_str(), advice.c_str());
}

}  // namespace nilio::tools::inspect
