#include "daemon/mapper/mapper_loop.hpp"

#include "nilio/core/clock.hpp"

#include "daemon/exit_status.hpp"

#include <algorithm>
#include <array>
#include <csignal>
#include <ctime>
#include <poll.h>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace nilio::daemon {
namespace {

using core::Duration;
using core::Time;

constexpr int kWaitMs = 100;
constexpr int kReturnPatienceMs = 1000;
constexpr Duration kLocalMapPeriod{1'000'000'000};
constexpr Duration kInterfacePeriod{1'000'000'000};

Time monotonic_now() { return {monotonic_ns()}; }
Time wall_now() { return {clock_ns(CLOCK_REALTIME)}; }

void fill_keyframe(const ipc::ScanCloud& scan, mapping::Keyframe& keyframe) {
  keyframe.stamp = {scan.stamp_ns};
  const auto& q = scan.orientation_xyzw;
  keyframe.T_odom_base = {Eigen::Quaterniond(q[3], q[0], q[1], q[2]), core::Vector3(scan.position.data())};
  keyframe.covariance =
      Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(scan.covariance.data());
  const std::size_t count = std::min<std::size_t>(scan.count, scan.points.size());
  keyframe.points.clear();
  for (std::size_t i = 0; i < count; ++i) {
    const ipc::CloudPoint& point = scan.points[i];
    keyframe.points.push_back({{point.x, point.y, point.z}, point.intensity});
  }
}

/// Without loop closure the map frame is odom.
void fill_points(const mapping::Submap& submap, std::vector<dds::SurfacePoint>& points) {
  const core::SE3& T = submap.T_odom_submap;
  points.clear();
  for (const mapping::Surface& surface : submap.surfaces) {
    const core::Vector3 p = T * surface.mean.cast<double>();
    const core::Vector3 n = T.rotation * surface.normal.cast<double>();
    points.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()),
                      surface.intensity, static_cast<float>(n.x()), static_cast<float>(n.y()),
                      static_cast<float>(n.z()), surface.thickness_m});
  }
}

}  // namespace

MapperLoop::MapperLoop(pid_t parent, int signals, MapperInputs inputs, mapping::MapWriter writer,
                       const mapping::SubmapConfig& config, std::unique_ptr<dds::MapPublisher> publisher,
                       int kept_submaps)
    : parent_(parent),
      signals_(signals),
      inputs_(std::move(inputs)),
      writer_(std::move(writer)),
      open_keyframes_(writer_.folder()),
      builder_(
          config, [this](const mapping::Submap& submap) { write(submap); }, writer_.next_id()),
      publisher_(std::move(publisher)),
      kept_submaps_(kept_submaps) {}

MapperLoop::~MapperLoop() = default;

void MapperLoop::recover() {
  const auto& submaps = writer_.content().submaps();
  // Late subscribers shall not miss what the earlier process has kept for them.
  const std::size_t kept = publisher_ ? static_cast<std::size_t>(kept_submaps_) : inputs_.submaps ? 1 : 0;
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    add_pose(submaps[i].first_stamp, submaps[i].T_map_submap);
    const std::size_t age = submaps.size() - i;
    if (age > std::max(kept, mapping::SubmapBuilder::kNeighbours)) continue;
    const auto submap = writer_.content().load(submaps[i]);
    if (!submap) {
      report_failure(submap.error().message);
      continue;
    }
    if (age <= kept) publish(*submap);
    if (age <= mapping::SubmapBuilder::kNeighbours) builder_.continue_after(*submap);
  }
  if (publisher_ && !poses_.poses.empty()) publisher_->publish_poses(poses_);
  const std::vector<mapping::Keyframe> keyframes = open_keyframes_.take(builder_.next_id());
  for (const mapping::Keyframe& keyframe : keyframes) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    builder_.add(keyframe);
  }
  if (!submaps.empty() || !keyframes.empty())
    spdlog::info("continues the map with {} submaps and {} keyframes of open ones", submaps.size(),
                 keyframes.size());
}

int MapperLoop::run() {
  bool stops = false;
  while (true) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    take_keyframes();
    const Time now = monotonic_now();
    publish_local_map(now);
    if (publisher_ && now >= refresh_due_) {
      refresh_due_ = now + kInterfacePeriod;
      publisher_->participant().refresh_interfaces();
    }
    if (stops) break;
    stops = !wait();
  }
  builder_.finish();
  open_keyframes_.remove_before(builder_.next_id() + 1);
  spdlog::info("stopped: {} submaps, {:.1f} MB in {}", writer_.content().submaps().size(),
               static_cast<double>(writer_.bytes()) * 1e-6, writer_.folder().string());
  return failure_logged_ ? kFailed : kDone;
}

void MapperLoop::take_keyframes() {
  while (inputs_.keyframes.read(*scan_)) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    fill_keyframe(*scan_, keyframe_);
    const std::uint32_t stretch = builder_.add(keyframe_);
    if (const auto written = open_keyframes_.add(keyframe_, stretch); !written)
      report_failure(written.error().message);
    inputs_.state->keyframes.fetch_add(1, std::memory_order_relaxed);
    local_map_changed_ = true;
  }
}

void MapperLoop::report_failure(const std::string& message) {
  inputs_.state->failed_writes.fetch_add(1, std::memory_order_relaxed);
  if (std::exchange(failure_logged_, true)) return;
  spdlog::error("{}; further failures are counted", message);
}

void MapperLoop::write(const mapping::Submap& submap) {
  inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
  if (const auto written = writer_.write(submap, wall_now()); !written) {
    report_failure(written.error().message);
    return;
  }
  open_keyframes_.remove_before(submap.id + 1);
  inputs_.state->submaps.store(writer_.content().submaps().size(), std::memory_order_relaxed);
  inputs_.state->map_bytes.store(writer_.bytes(), std::memory_order_relaxed);
  publish(submap);
  if (!publisher_ || submap.keyframes.empty()) return;
  add_pose(submap.keyframes.front().stamp, submap.T_odom_submap);
  publisher_->publish_poses(poses_);
}

void MapperLoop::publish(const mapping::Submap& submap) {
  if (submap.keyframes.empty() || (!publisher_ && !inputs_.submaps)) return;
  fill_points(submap, points_);
  if (publisher_) publisher_->publish_submap(submap.keyframes.front().stamp, points_);
  if (inputs_.submaps) return_submap(submap);
}

/// Waits a moment for niliod to take earlier ones: a replay completes submaps faster than they are read.
void MapperLoop::return_submap(const mapping::Submap& submap) {
  for (int waited_ms = 0; waited_ms < kReturnPatienceMs && !inputs_.submaps->has_room(); ++waited_ms)
    ::poll(nullptr, 0, 1);
  returned_->id = submap.id;
  returned_->stamp_ns = submap.keyframes.front().stamp.ns;
  returned_->count = std::min(points_.size(), ipc::SubmapCloud::kCapacity);
  for (std::size_t i = 0; i < returned_->count; ++i) {
    const dds::SurfacePoint& point = points_[i * points_.size() / returned_->count];
    returned_->points[i] = {point.x, point.y, point.z, point.intensity};
  }
  inputs_.submaps->push(*returned_, returned_->bytes());
}

void MapperLoop::add_pose(Time stamp, const core::SE3& T_map_submap) {
  const core::Vector3& t = T_map_submap.translation;
  const Eigen::Quaterniond& q = T_map_submap.rotation;
  poses_.stamp = stamp;
  poses_.poses.push_back({stamp, "", {t.x(), t.y(), t.z()}, {q.x(), q.y(), q.z(), q.w()}});
}

void MapperLoop::publish_local_map(Time now) {
  if (!publisher_ || !local_map_changed_ || now < local_map_due_ || publisher_->local_map_subscribers() == 0)
    return;
  local_map_due_ = now + kLocalMapPeriod;
  local_map_changed_ = false;
  const std::optional<mapping::Submap> local_map = builder_.local_map();
  if (!local_map) return;
  fill_points(*local_map, points_);
  publisher_->publish_local_map(keyframe_.stamp, points_);
}

/// Waits for keyframes. False after a stop signal, or the end of the parent.
bool MapperLoop::wait() {
  std::array<pollfd, 2> waited{{{inputs_.wake.file_descriptor(), POLLIN, 0}, {signals_, POLLIN, 0}}};
  ::poll(waited.data(), waited.size(), kWaitMs);
  inputs_.wake.clear();
  bool stop = false;
  signalfd_siginfo signal{};
  while (read(signals_, &signal, sizeof signal) == sizeof signal) stop = true;
  return !stop && (parent_ == 0 || getppid() == parent_);
}

}  // namespace nilio::daemon
