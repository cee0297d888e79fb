#include "tools/inspect/report/report.hpp"

#include "tools/common/text.hpp"

#include <algorithm>

namespace nilio::tools::inspect {

namespace {

unsigned long long printable(std::uint64_t n) { return n; }

const char* content_name(StreamContent content) {
  switch (content) {
    case StreamContent::kData:
      return "LiDAR data";
    case StreamContent::kTelemetry:
      return "telemetry";
    case StreamContent::kOther:
      break;
  }
  return "other";
}

std::string other_records(const CaptureFindings& capture) {
  std::string text;
  const auto add = [&](std::uint64_t n, const char* what) {
    if (n > 0) text += format(", %llu %s", printable(n), what);
  };
  add(capture.other_ip, "IPv4 but not UDP");
  add(capture.not_ipv4, "not IPv4");
  add(capture.fragments, "IPv4 fragments");
  add(capture.cut, "cut by the snap length");
  add(capture.malformed, "malformed");
  return text;
}

std::string size_text(const StreamFindings& stream) {
  return stream.smallest == stream.largest ? format("%u", stream.largest)
                                           : format("%u-%u", stream.smallest, stream.largest);
}

/// All LiDAR streams, and the other ones with most packets.
std::string stream_table(const CaptureFindings& capture) {
  constexpr std::size_t kOthersShown = 8;
  std::vector<StreamFindings> shown = capture.streams;
  std::stable_sort(shown.begin(), shown.end(), [](const StreamFindings& a, const StreamFindings& b) {
    const bool a_known = a.content != StreamContent::kOther;
    const bool b_known = b.content != StreamContent::kOther;
    if (a_known != b_known) return a_known;
    return !a_known && a.packets > b.packets;
  });
  std::string text = format("\n  %-21s    %-7s %10s %14s %10s  %s\n", "sender", "to port", "packets", "bytes",
                            "size", "content");
  std::size_t others = 0;
  for (const StreamFindings& stream : shown) {
    if (stream.content == StreamContent::kOther && ++others > kOthersShown) continue;
    const std::string sender = address_text(stream.address) + ":" + std::to_string(stream.sender_port);
    text += format("  %-21s -> %-7u %10llu %14llu %10s  %s\n", sender.c_str(), stream.destination_port,
                   printable(stream.packets), printable(stream.bytes), size_text(stream).c_str(),
                   content_name(stream.content));
  }
  if (others > kOthersShown)
    text += format("  and %zu other streams (--json has them)\n", others - kOthersShown);
  if (capture.further_streams > 0)
    text += format("  and %llu datagrams of further streams\n", printable(capture.further_streams));
  return text;
}

std::string capture_report(const CaptureFindings& capture) {
  std::string text = capture.path + "\n";
  if (capture.records > 0) {
    text += format("  %s to %s UTC, %s\n", utc_text(capture.first).c_str(), utc_text(capture.last).c_str(),
                   span_text(capture.duration_s()).c_str());
  }
  text += format("  %llu records: %llu UDP%s\n", printable(capture.records), printable(capture.udp),
                 other_records(capture).c_str());
  if (!capture.early_end.empty()) text += "  " + capture.early_end + "\n";
  if (!capture.streams.empty()) text += stream_table(capture);
  for (const SensorFindings& sensor : capture.sensors) text += "\n" + sensor_report(sensor);
  for (const auto& [address, telemetry] : capture.lone_telemetry) {
    text += format("\n  %s sends %llu telemetry packets, but no data packets\n",
                   address_text(address).c_str(), printable(telemetry.packets));
  }
  return text;
}

std::string relation_text(const CanFindings& can, const CaptureFindings& capture) {
  if (!can.has_wall_clock())
    return format(
        "  %-16s the log's stamps are relative to its start and cannot be compared with the capture - record "
        "with "
        "'candump -L' or '-l'\n",
        "with the LiDAR");
  const TimeRelation relation = relate(can, capture);
  const char* order = relation.start_offset_s > 0.0 ? "after" : "before";
  if (relation.apart_s > 0.0)
    return format("  %-16s NO OVERLAP with %s: %s apart, the log starts %s %s it\n", "with the LiDAR",
                  capture.path.c_str(), span_text(relation.apart_s).c_str(),
                  span_text(std::abs(relation.start_offset_s)).c_str(), order);
  return format("  %-16s covers %.1f %% of %s, starts %s %s it\n", "with the LiDAR",
                capture.duration_s() > 0.0 ? 100.0 * relation.overlap_s / capture.duration_s() : 100.0,
                capture.path.c_str(), span_text(std::abs(relation.start_offset_s)).c_str(), order);
}

}  // namespace

std::string inspect_report(const RecordingFindings& findings) {
  std::string text;
  for (const CaptureFindings& capture : findings.captures)
    text += (text.empty() ? "" : "\n") + capture_report(capture);
  for (const BagFindings& bag : findings.bags) text += (text.empty() ? "" : "\n") + bag_report(bag);
  for (const CanFindings& can : findings.can_logs) {
    text += (text.empty() ? "" : "\n") + can_report(can);
    if (can.frames == 0) continue;
    for (const CaptureFindings& capture : findings.captures)
      if (capture.records > 0) text += relation_text(can, capture);
  }
  if (findings.drive) text += "\n" + imu_check_report(*findings.drive);
  if (!findings.drive_problem.empty())
    text += "\nIMU against LiDAR\n  not checked: " + findings.drive_problem + "\n";
  return text;
}

}  // namespace nilio::tools::inspect
