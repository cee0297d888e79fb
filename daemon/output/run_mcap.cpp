#include "daemon/output/run_mcap.hpp"

#include <algorithm>
#include <utility>

namespace nilio::daemon {

namespace {

constexpr std::int64_t kReportPeriodNs = 1'000'000'000;

}  // namespace

RunMcap::RunMcap(std::filesystem::path path, RunFrames frames)
    : frames_(std::move(frames)), writer_(std::move(path), run_channels()) {}

void RunMcap::write(RunChannel channel, std::int64_t stamp_ns) {
  writer_.add(static_cast<std::size_t>(channel), {stamp_ns}, message_);
}

void RunMcap::add(const ipc::PoseRecord& record) {
  latest_ns_ = record.stamp_ns;
  write_odometry(record, frames_, message_);
  write(RunChannel::kOdometry, record.stamp_ns);
  const StampedPose pose{record.stamp_ns, record.position, record.orientation_xyzw};
  write_transform(pose, frames_, message_);
  write(RunChannel::kTransform, record.stamp_ns);
  const std::int64_t received = record.stage_time_ns(ipc::Stage::kReceived);
  if (received > 0) {
    const std::int64_t latency_ns = record.stage_time_ns(ipc::Stage::kDelivered) - received;
    write_number(static_cast<double>(latency_ns) * 1e-6, message_);
    write(RunChannel::kLatency, record.stamp_ns);
  }
  extend_path(pose);
  report(record);
}

/// The path is written whenever it grew by a tenth: the file then holds a fixed multiple of it.
void RunMcap::extend_path(const StampedPose& pose) {
  if (!path_.empty() && pose.stamp_ns - path_.back().stamp_ns < path_period_ns_) return;
  path_.push_back(pose);
  if (path_.size() >= kMaxPathPoses) {
    for (std::size_t i = 0; 2 * i < path_.size(); ++i) path_[i] = path_[2 * i];
    path_.resize((path_.size() + 1) / 2);
    path_period_ns_ *= 2;
    written_path_poses_ = path_.size();
  }
  if (path_.size() < written_path_poses_ + 1 + written_path_poses_ / 10) return;
  written_path_poses_ = path_.size();
  write_path(path_, frames_, message_);
  write(RunChannel::kPath, pose.stamp_ns);
}

/// Diagnostics as the publisher reports them, once a second of the scans' time.
void RunMcap::report(const ipc::PoseRecord& record) {
  counts_.add(record, resets_.add(record));
  if (!reported_ns_) reported_ns_ = record.stamp_ns;
  if (record.stamp_ns - *reported_ns_ < kReportPeriodNs) return;
  reported_ns_ = record.stamp_ns;
  const dds::DiagnosticInput input{record, {}, counts_ - reported_};
  reported_ = counts_;
  write_diagnostics(dds::make_diagnostics(input, {record.stamp_ns}), message_);
  write(RunChannel::kDiagnostics, record.stamp_ns);
}

void RunMcap::add(const CloudRecord& cloud) {
  write_scan(cloud, frames_, message_);
  write(RunChannel::kScan, cloud.stamp_ns);
}

void RunMcap::add(const ipc::SubmapCloud& submap) {
  if (submap.id < next_submap_) return;
  next_submap_ = submap.id + 1;
  write_submap(submap, frames_, message_);
  write(RunChannel::kSubmap, std::max(latest_ns_, submap.stamp_ns));
}

void RunMcap::finish() {
  if (!path_.empty() && path_.size() > written_path_poses_) {
    write_path(path_, frames_, message_);
    write(RunChannel::kPath, path_.back().stamp_ns);
  }
  writer_.finish();
}

}  // namespace nilio::daemon
