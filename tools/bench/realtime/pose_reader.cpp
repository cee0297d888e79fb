#include "tools/bench/realtime/pose_reader.hpp"

#include "ipc/dds/reports.hpp"
#include "tools/common/files.hpp"
#include "tools/watch/packet_to_pose.hpp"

#include <sstream>
#include <utility>

namespace nilio::tools::bench {

namespace {

constexpr core::Duration kReaderPatience = core::Duration::from_seconds(5.0);
// Peers in both directions, because loopback has no multicast.
constexpr const char* kLoopback =
    "CYCLONEDDS_URI=<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/>"
    "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
    "</ParticipantIndex><Peers><Peer Address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

}  // namespace

ReaderFigures read_reader_lines(const std::string& text, const std::string& host_id) {
  ReaderFigures figures;
  watch::PacketToPose latency(host_id);
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    core::Time stamp;
    std::int64_t ns = 0;
    if (kind == "ready") words >> figures.is_fifo;
    if (kind == "pose" && words >> stamp.ns >> ns) {
      ++figures.poses;
      latency.add_pose(stamp, ns);
    }
    dds::ScanReport report;
    if (kind == "packet" && words >> report.stamp.ns >> ns >> report.host_id) {
      report.stages.push_back({"received", ns});
      latency.add_report(report);
    }
  }
  figures.packet_to_reader = ipc::summarize("packet to reader", latency.histogram());
  return figures;
}

core::Result<PoseReader> PoseReader::start(std::uint32_t domain, const std::filesystem::path& folder) {
  const core::Result<std::filesystem::path> program = find_sibling_program("nilio-pose-reader");
  if (!program) return program.error();
  const std::filesystem::path log = folder / "reader.log";
  auto process = ChildProcess::start(*program, {std::to_string(domain)}, log, {kLoopback});
  if (!process) return process.error();
  return PoseReader(std::move(process).value(), log);
}

bool PoseReader::is_ready() const { return file_text(log_).value_or("").find("ready ") != std::string::npos; }

ReaderFigures PoseReader::stop() {
  process_.stop(kReaderPatience);
  return read_reader_lines(file_text(log_).value_or(""), dds::read_host_id());
}

}  // namespace nilio::tools::bench
