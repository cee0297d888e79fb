#include "tools/inspect/capture.hpp"

#include "tools/inspect/report/report_text.hpp"

#include <algorithm>
#include <string_view>
#include <tuple>
#include <utility>

namespace nilio::tools {

namespace {

constexpr std::size_t kMostSensors = 32;
constexpr std::size_t kMostStreams = 256;
constexpr std::uint16_t kUsualTelemetryPort = 8308;
constexpr std::size_t kNmeaOffset = 0xCE;

/// Every data packet of every model begins with this block flag.
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
      // The telemetry of a sender with several data streams is told with the first.
      const auto telemetry = telemetry_.find(key.first);
      if (telemetry == telemetry_.end()) continue;
      findings_.sensors.back().telemetry = telemetry->second.findings();
      telemetry_.erase(telemetry);
    }
    for (const auto& [address, telemetry] : telemetry_)
      findings_.lone_telemetry.emplace(address, telemetry.findings());
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
    if (known == streams_.end() && streams_.size() == kMostStreams) {
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
      if (telemetry_.size() < kMostSensors || telemetry_.contains(packet.sender_address))
        telemetry_[packet.sender_address].add(packet);
      for (auto& [key, sensor] : sensors_) {
        if (key.first == packet.sender_address) sensor.add_telemetry(packet);
      }
      return StreamContent::kTelemetry;
    }
    const SensorKey key{packet.sender_address, packet.destination_port};
    auto sensor = sensors_.find(key);
    if (sensor == sensors_.end()) {
      if (!looks_like_data(record) || sensors_.size() == kMostSensors) return StreamContent::kOther;
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

/// "12 to port 5353, ...", the most frequent first.
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
  while (file->next(record)) inspector.add(record);
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
    return capture.path + ": a capture without any packet" +
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

}  // namespace nilio::tools
