#include "daemon/output/run_recorder.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "daemon/input/replay_files.hpp"

#include <fstream>
#include <system_error>

namespace nilio::daemon {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

}  // namespace

Result<std::unique_ptr<RunRecorder>> RunRecorder::create(const fs::path& folder,
                                                         const std::string& effective_config,
                                                         const drivers::DiskState::Report& report) {
  std::unique_ptr<RunRecorder> recorder(new RunRecorder(report));
  recorder->folder_ = folder;
  auto parts = drivers::RecordParts::create(folder, {}, recorder->counters_, report);
  if (!parts) return parts.error();
  recorder->parts_ = std::make_unique<drivers::RecordParts>(std::move(parts).value());
  const Result<ReplayFiles> found = sort_replay_files({folder.string()});
  if (!found || !found->captures.empty() || !found->can_logs.empty())
    return Error{folder.string() + ": contains a recording already - give --record a new folder"};
  std::ofstream config(folder / "nilio.yaml");
  config << effective_config;
  if (!config.flush())
    return Error{(folder / "nilio.yaml").string() + ": cannot be written - check that the disk is not full"};
  return recorder;
}

void RunRecorder::open_decisions(const std::string& header) {
  const std::string line = header + '\n';
  decisions_ = drivers::RecordFile(folder_ / "decisions.jsonl", {line.begin(), line.end()});
}

void RunRecorder::add(const drivers::Packet& packet, std::int64_t now_ns) {
  record_.clear();
  // Only a host clock before 1970 or after 2106 gives stamps that a capture cannot store.
  if (drivers::append_pcap_record(record_, packet)) {
    parts_->append(drivers::RecordStream::kLidar, record_, now_ns);
  } else {
    ++unrecordable_;
  }
}

void RunRecorder::add(const drivers::CanFrame& frame, const std::string& interface_name,
                      std::int64_t now_ns) {
  const std::string line = drivers::format_candump_line(frame, interface_name) + '\n';
  record_.assign(line.begin(), line.end());
  parts_->append(drivers::RecordStream::kCan, record_, now_ns);
}

void RunRecorder::add(const ScanDecision& decision) {
  const std::string line = decision_line(decision) + '\n';
  if (!decisions_.append({reinterpret_cast<const std::uint8_t*>(line.data()), line.size()}))
    ++lost_decisions_;
}

void RunRecorder::flush(std::int64_t now_ns) {
  // Data first: decisions about scans that are not recorded could not be repeated.
  parts_->flush(now_ns);
  if (!disk_.is_due(now_ns)) return;
  if (const int error = decisions_.write_pending(); error != 0) {
    disk_.note_failure(decisions_.path(), error, now_ns, lost_decisions_);
  } else {
    disk_.note_success(decisions_.path(), lost_decisions_);
  }
}

void RunRecorder::close(std::int64_t now_ns) {
  parts_->close(now_ns);
  disk_.retry_at_once();
  flush(now_ns);
  lost_decisions_ += decisions_.drop_pending();
  decisions_.close();
}

std::uint64_t RunRecorder::lost() const {
  return counters_.lost[0].load() + counters_.lost[1].load() + lost_decisions_ + unrecordable_;
}

}  // namespace nilio::daemon
