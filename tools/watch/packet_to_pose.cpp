#include "tools/watch/packet_to_pose.hpp"

#include <algorithm>

namespace nilio::tools::watch {
namespace {

// Poses and reports that wait for each other. Covers any delay of a report.
constexpr std::size_t kMaxWaiting = 256;

}  // namespace

std::int64_t PacketToPose::match(std::deque<Waiting>& others, std::deque<Waiting>& own, const Waiting& item) {
  const auto found = std::find_if(others.begin(), others.end(),
                                  [&](const Waiting& other) { return other.stamp == item.stamp; });
  if (found == others.end()) {
    if (own.size() >= kMaxWaiting) own.pop_front();
    own.push_back(item);
    return 0;
  }
  const std::int64_t ns = found->ns;
  others.erase(found);
  return ns;
}

void PacketToPose::add_pose(core::Time stamp, std::int64_t received_ns) {
  const std::int64_t packet_ns = match(packets_, poses_, {stamp, received_ns});
  if (packet_ns != 0) histogram_->record(received_ns - packet_ns);
}

void PacketToPose::add_report(const dds::ScanReport& report) {
  if (report.host_id.empty() || report.host_id != host_id_) {
    ++of_other_machines_;
    return;
  }
  const auto packet = std::find_if(report.stages.begin(), report.stages.end(),
                                   [](const dds::StageStamp& stage) { return stage.name == "received"; });
  if (packet == report.stages.end() || packet->monotonic_ns <= 0) return;
  const std::int64_t pose_ns = match(poses_, packets_, {report.stamp, packet->monotonic_ns});
  if (pose_ns != 0) histogram_->record(pose_ns - packet->monotonic_ns);
}

}  // namespace nilio::tools::watch
