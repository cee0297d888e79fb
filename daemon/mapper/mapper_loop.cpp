#include "daemon/mapper/mapper_loop.hpp"

#include "nilio/core/clock.hpp"
#include "nilio/core/units.hpp"

#include "daemon/exit_status.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <csignal>
#include <cstdlib>
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
constexpr Duration kTransformPeriod = Duration::from_milliseconds(50.0);
// A correction enters in steps no longer than this.
constexpr Duration kLongestStep = Duration::from_milliseconds(200.0);
// The end of this process, beside the loops.
constexpr Duration kEndReserve = Duration::from_milliseconds(250.0);
// For the loops, if the process is stopped by somebody else than niliod.
constexpr Duration kUntoldPatience = Duration::from_seconds(10.0);
constexpr int kEndPeriodMs = 5;
constexpr double kMovedMetres = 0.1;
constexpr double kMovedRadians = 0.003;

Time wall_now() { return {clock_ns(CLOCK_REALTIME)}; }

void fill_keyframe(const ipc::ScanCloud& scan, mapping::Keyframe& keyframe) {
  keyframe.stamp = {scan.stamp_ns};
  keyframe.T_odom_base = {core::from_xyzw(scan.orientation_xyzw), core::Vector3(scan.position.data())};
  keyframe.covariance =
      Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(scan.covariance.data());
  const std::size_t count = std::min<std::size_t>(scan.count, scan.points.size());
  keyframe.points.clear();
  for (std::size_t i = 0; i < count; ++i) {
    const ipc::CloudPoint& point = scan.points[i];
    keyframe.points.push_back({{point.x, point.y, point.z}, point.intensity});
  }
}

void fill_points(const mapping::Submap& submap, const core::SE3& T_target_submap,
                 std::vector<dds::SurfacePoint>& points) {
  const core::SE3& T = T_target_submap;
  points.clear();
  for (const mapping::Surface& surface : submap.surfaces) {
    const core::Vector3 p = T * surface.mean.cast<double>();
    const core::Vector3 n = T.rotation * surface.normal.cast<double>();
    points.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()),
                      surface.intensity, static_cast<float>(n.x()), static_cast<float>(n.y()),
                      static_cast<float>(n.z()), surface.thickness_m});
  }
}

/// Line of localisation.txt: stamp and T_map_odom as in a trajectory, state, share of supported points,
/// standard deviations of position (m) and orientation (deg).
std::string line_of(const mapping::Localisation& result) {
  const core::Vector3& t = result.T_map_odom.translation;
  const Eigen::Quaterniond& q = result.T_map_odom.rotation;
  const core::Matrix6& c = result.covariance;
  return fmt::format(
      "{}.{:09} {:.9f} {:.9f} {:.9f} {:.12f} {:.12f} {:.12f} {:.12f} {} {:.3f} {:.4f} {:.4f}\n",
      result.stamp.ns / kNanosecondsPerSecond, result.stamp.ns % kNanosecondsPerSecond, t.x(), t.y(), t.z(),
      q.x(), q.y(), q.z(), q.w(),
      result.state == mapping::LocalisationState::kLocalised ? "localised" : "odometry_only",
      result.supported, std::sqrt(c.topLeftCorner<3, 3>().trace()),
      std::sqrt(c.bottomRightCorner<3, 3>().trace()) * kDegreesPerRadian);
}

/// Whether a cloud of the earlier pose is no longer right.
bool is_moved(const core::SE3& before, const core::SE3& after) {
  return (after.translation - before.translation).norm() > kMovedMetres ||
         before.rotation.angularDistance(after.rotation) > kMovedRadians;
}

}  // namespace

MapperLoop::MapperLoop(pid_t parent, int signals, MapperInputs inputs,
                       std::optional<mapping::MapWriter> writer, const MapperLoopConfig& config,
                       std::unique_ptr<dds::MapPublisher> publisher)
    : parent_(parent),
      signals_(signals),
      inputs_(std::move(inputs)),
      writer_(std::move(writer)),
      builder_(
          config.submaps, [this](const mapping::Submap& submap) { write(submap); },
          writer_ ? writer_->next_id() : 0),
      publisher_(std::move(publisher)),
      kept_submaps_(static_cast<std::size_t>(config.kept_submaps)) {
  if (writer_) open_keyframes_.emplace(writer_->folder());
  if (writer_ && config.closes_loops) loops_ = std::make_unique<LoopThread>(*writer_);
  if (config.saved_map.empty()) return;
  saved_map_ = config.saved_map.string();
  localisation_ = std::make_unique<LocalisationThread>(LocalisationThreadConfig{
      config.saved_map, config.continues_run, config.submaps.range_m, config.keeps_all});
  inputs_.state->localisation.store(ipc::MapperLocalisation::kLoading);
  localisation_path_ = config.localisation_file;
}

MapperLoop::~MapperLoop() = default;

void MapperLoop::recover() {
  if (writer_) recover_map();
  publish_poses();
  if (!publisher_) return;
  const bool is_new = frame_.submaps().empty();
  const std::string cause = is_new ? "start" : "restart";
  if (has_map_frame()) publisher_->publish_transform(keyframe_.stamp, frame_.published());
  publisher_->publish_correction(
      {.stamp = keyframe_.stamp,
       .cause = localisation_ ? cause + "; searching in the map " + saved_map_ : cause,
       .loops = inputs_.state->loops.load(),
       .jumped = true});
}

void MapperLoop::recover_map() {
  const auto& submaps = writer_->content().submaps();
  std::vector<MapFrame::Placed> placed;
  for (const mapping::SubmapEntry& entry : submaps) {
    placed.push_back({entry.id, entry.first_stamp, entry.T_odom_submap, entry.T_map_submap});
    if (loops_) loops_->add(entry);
  }
  frame_.restore(std::move(placed), writer_->content().T_map_odom());
  // Late subscribers shall not miss what the earlier process has kept for them.
  const std::size_t kept = publisher_ ? kept_submaps_ : inputs_.submaps ? 1 : 0;
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    const std::size_t age = submaps.size() - i;
    if (age > std::max(kept, mapping::SubmapBuilder::kNeighbours)) continue;
    const auto submap = writer_->content().load(submaps[i]);
    if (!submap) {
      report_failure(submap.error().message);
      continue;
    }
    if (age <= kept) publish(*submap, submaps[i].T_map_submap);
    if (age == 1) {
      return_submap(*submap);
      if (!submap->keyframes.empty()) {
        keyframe_.stamp = submap->keyframes.back().stamp;
        keyframe_.T_odom_base = submap->T_odom_submap * submap->keyframes.back().T_submap_base;
      }
    }
    if (age <= mapping::SubmapBuilder::kNeighbours) builder_.continue_after(*submap);
  }
  const std::vector<mapping::Keyframe> keyframes = open_keyframes_->take(builder_.next_id());
  for (const mapping::Keyframe& keyframe : keyframes) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    builder_.add(keyframe);
    keyframe_.stamp = keyframe.stamp;
    keyframe_.T_odom_base = keyframe.T_odom_base;
  }
  if (!submaps.empty() || !keyframes.empty())
    spdlog::info("continues the map with {} submaps, {} loops and {} keyframes of open submaps",
                 submaps.size(), inputs_.state->loops.load(), keyframes.size());
}

int MapperLoop::run() {
  bool stops = false;
  while (true) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    take_keyframes();
    take_loops();
    take_localisation();
    const Time now = monotonic_now();
    publish_transform(now);
    if (publisher_) {
      publish_moved();
      publish_local_map(now);
      if (now >= refresh_due_) {
        refresh_due_ = now + kInterfacePeriod;
        publisher_->participant().refresh_interfaces();
      }
    }
    if (stops) break;
    stops = !wait();
  }
  builder_.finish();
  if (open_keyframes_) open_keyframes_->remove_before(builder_.next_id() + 1);
  finish_localisation();
  const bool is_closed = finish_loops();
  if (writer_)
    spdlog::info("stopped: {} submaps, {:.1f} MB in {}; {} loops", writer_->content().submaps().size(),
                 static_cast<double>(writer_->bytes()) * 1e-6, writer_->folder().string(),
                 inputs_.state->loops.load());
  const int status = failure_logged_ ? kFailed : kDone;
  // A search cannot be ended; the files are whole.
  if (!is_closed) std::_Exit(status);
  return status;
}

/// When the last work has to be over.
std::int64_t MapperLoop::end_ns() const {
  const std::int64_t told_ns = inputs_.state->stop_deadline_ns.load();
  return told_ns > 0 ? told_ns - kEndReserve.ns : monotonic_now().ns + kUntoldPatience.ns;
}

/// Waits for the results of the last keyframes.
void MapperLoop::finish_localisation() {
  if (!localisation_) return;
  const std::int64_t deadline_ns = end_ns();
  while (!localisation_->is_done() && monotonic_now().ns < deadline_ns) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    ::poll(nullptr, 0, kEndPeriodMs);
  }
  take_localisation();
  if (localisation_ && !has_map_frame())
    spdlog::warn(
        "localisation: no place found in the map; last search: {} - drive on, or check that the map shows "
        "these roads",
        localisation_refusal_.empty() ? "not enough data" : localisation_refusal_);
}

/// Waits for the loops of the last submaps as long as niliod waits for this process. False if that is too
/// short.
bool MapperLoop::finish_loops() {
  if (!loops_) return true;
  loops_->finish();
  const std::int64_t deadline_ns = end_ns();
  while (!loops_->is_done() && monotonic_now().ns < deadline_ns) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    take_loops();
    ::poll(nullptr, 0, kEndPeriodMs);
  }
  const bool is_done = loops_->is_done();
  take_loops();
  if (!is_done)
    spdlog::warn("loop closure: no time for the last {} submaps - complete it with nilio map close {}",
                 loops_->waiting() + 1, writer_->folder().string());
  return is_done;
}

void MapperLoop::take_keyframes() {
  while (inputs_.keyframes.read(*scan_)) {
    inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
    fill_keyframe(*scan_, keyframe_);
    const std::uint32_t stretch = builder_.add(keyframe_);
    while (localisation_ && !localisation_->add(keyframe_)) {
      inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
      ::poll(nullptr, 0, 1);
      take_localisation();
    }
    const auto written = open_keyframes_ ? open_keyframes_->add(keyframe_, stretch)
                                         : core::Result<std::monostate>(std::monostate{});
    if (!written) report_failure(written.error().message);
    inputs_.state->keyframes.fetch_add(1, std::memory_order_relaxed);
    local_map_changed_ = true;
  }
}

void MapperLoop::take_loops() {
  if (!loops_) return;
  if (const auto failure = loops_->take_failure()) report_failure(*failure);
  const std::optional<LoopUpdate> update = loops_->take();
  if (!update) return;
  inputs_.state->loops.store(update->loops, std::memory_order_relaxed);
  // The saved map is the frame then; loops correct the map that is written.
  if (localisation_) return;
  const MapFrame::Change change = frame_.correct(update->poses, update->T_map_odom, keyframe_.T_odom_base);
  if (!update->cause.empty())
    spdlog::info("map: {}; the vehicle {} by {:.3f} m, {:.3f} deg", update->cause,
                 change.jumped ? "jumps" : "moves gradually", change.distance_m,
                 change.angle_rad * kDegreesPerRadian);
  if (!publisher_) return;
  if (!update->cause.empty())
    publisher_->publish_correction(
        {keyframe_.stamp, update->cause, update->loops, change.distance_m, change.angle_rad, change.jumped});
  publish_poses();
  const auto& submaps = frame_.submaps();
  const std::size_t first_kept = submaps.size() - std::min(submaps.size(), kept_submaps_);
  for (std::size_t i = first_kept; i < submaps.size(); ++i) {
    const auto cloud = cloud_poses_.find(submaps[i].id);
    if (cloud != cloud_poses_.end() && is_moved(cloud->second, submaps[i].T_map_submap)) {
      next_moved_ = first_kept;
      break;
    }
  }
}

/// Whether it is known where the frame `map` is.
bool MapperLoop::has_map_frame() const {
  return !localisation_ || localisation_state_ != mapping::LocalisationState::kSearching;
}

void MapperLoop::take_localisation() {
  if (!localisation_) return;
  if (const auto loaded = localisation_->take_loaded()) {
    if (!loaded->ok) {
      spdlog::error("localisation: {}; poses go on without it", loaded->message);
      return end_localisation("no localisation: " + loaded->message);
    }
    saved_map_ = loaded->message;
    inputs_.state->localisation.store(ipc::MapperLocalisation::kSearching);
    spdlog::info("localisation: {}", saved_map_);
  }
  for (const mapping::Localisation& result : localisation_->take()) {
    apply(result);
    if (!localisation_) return;
  }
  inputs_.state->localisation_dropped.store(localisation_->dropped(), std::memory_order_relaxed);
}

/// `map` is a frame of this run from here on.
void MapperLoop::end_localisation(const std::string& cause) {
  inputs_.state->localisation.store(ipc::MapperLocalisation::kFailed);
  localisation_.reset();
  if (!publisher_) return;
  publisher_->publish_transform(keyframe_.stamp, frame_.published());
  publisher_->publish_correction({.stamp = keyframe_.stamp, .cause = cause, .jumped = true});
}

/// The folder is made by the run, which may begin later than this process.
void MapperLoop::write_localisation(const mapping::Localisation& result) {
  if (!localisation_file_.is_open()) localisation_file_.open(localisation_path_, std::ios::app);
  if (!(localisation_file_ << line_of(result)).flush())
    report_failure(localisation_path_.string() + ": cannot be written - check the disk");
}

void MapperLoop::apply(const mapping::Localisation& result) {
  using State = mapping::LocalisationState;
  localisation_refusal_ = result.refusal;
  if (result.state == State::kSearching) return;
  if (result.state == State::kElsewhere) {
    spdlog::warn("localisation: the map starts anew, the earlier run has not been here; last search: {}",
                 result.refusal);
    return end_localisation("starts anew, the earlier run has not been here");
  }
  const bool is_start = localisation_state_ == State::kSearching;
  localisation_state_ = result.state;
  inputs_.state->localisation.store(result.state == State::kLocalised ? ipc::MapperLocalisation::kLocalised
                                                                      : ipc::MapperLocalisation::kOutside);
  if (result.state == State::kLocalised)
    inputs_.state->localised_keyframes.fetch_add(1, std::memory_order_relaxed);
  if (!localisation_path_.empty()) write_localisation(result);
  const MapFrame::Change change = frame_.localise(result.T_map_odom, keyframe_.T_odom_base, is_start);
  if (result.event.empty()) return;
  spdlog::info("localisation: {}{}", result.event,
               is_start ? ""
                        : fmt::format("; the vehicle {} by {:.3f} m, {:.3f} deg",
                                      change.jumped ? "jumps" : "moves gradually", change.distance_m,
                                      change.angle_rad * kDegreesPerRadian));
  if (!publisher_) return;
  publisher_->publish_correction({.stamp = result.stamp,
                                  .cause = "localisation: " + result.event + "; " + saved_map_,
                                  .distance_m = change.distance_m,
                                  .angle_rad = change.angle_rad,
                                  .jumped = change.jumped});
  if (!is_start) return;
  publisher_->publish_transform(result.stamp, frame_.published());
  publish_poses();
  // Clouds have waited for their frame.
  next_moved_ = frame_.submaps().size() - std::min(frame_.submaps().size(), kept_submaps_);
}

void MapperLoop::report_failure(const std::string& message) {
  inputs_.state->failed_writes.fetch_add(1, std::memory_order_relaxed);
  if (std::exchange(failure_logged_, true)) return;
  spdlog::error("{}; further failures are counted", message);
}

/// False if the disk refuses it.
bool MapperLoop::write_file(const mapping::Submap& submap) {
  if (const auto written = writer_->write(submap, wall_now()); !written) {
    report_failure(written.error().message);
    return false;
  }
  open_keyframes_->remove_before(submap.id + 1);
  inputs_.state->submaps.store(writer_->content().submaps().size(), std::memory_order_relaxed);
  inputs_.state->map_bytes.store(writer_->bytes(), std::memory_order_relaxed);
  if (loops_) loops_->add(writer_->content().submaps().back());
  return true;
}

void MapperLoop::write(const mapping::Submap& submap) {
  inputs_.state->heartbeat.fetch_add(1, std::memory_order_relaxed);
  if (writer_ && !write_file(submap)) return;
  const Time first_stamp = submap.keyframes.empty() ? Time{} : submap.keyframes.front().stamp;
  frame_.add(submap.id, first_stamp, submap.T_odom_submap);
  return_submap(submap);
  publish(submap, frame_.submaps().back().T_map_submap);
  publish_poses();
}

void MapperLoop::publish(const mapping::Submap& submap, const core::SE3& T_map_submap) {
  if (submap.keyframes.empty() || !publisher_ || !has_map_frame()) return;
  fill_points(submap, T_map_submap, points_);
  publisher_->publish_submap(submap.keyframes.front().stamp, points_);
  cloud_poses_[submap.id] = T_map_submap;
  if (cloud_poses_.size() > kept_submaps_) cloud_poses_.erase(cloud_poses_.begin());
}

/// Clouds that are kept for late subscribers shall be where map has them now: if one has moved, all are
/// published again, in their order, one a call.
void MapperLoop::publish_moved() {
  if (!next_moved_ || inputs_.keyframes.taken() != inputs_.keyframes.written()) return;
  const std::size_t i = (*next_moved_)++;
  // Without files there is nothing to publish again.
  if (!writer_ || i >= frame_.submaps().size()) return next_moved_.reset();
  const auto submap = writer_->content().load(writer_->content().submaps()[i]);
  if (submap) publish(*submap, frame_.submaps()[i].T_map_submap);
}

/// Waits a moment for niliod to take earlier ones: a replay completes submaps faster than they are read.
void MapperLoop::return_submap(const mapping::Submap& submap) {
  if (!inputs_.submaps || submap.keyframes.empty()) return;
  fill_points(submap, submap.T_odom_submap, points_);
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

void MapperLoop::publish_poses() {
  if (!publisher_ || frame_.submaps().empty() || !has_map_frame()) return;
  dds::Path path;
  for (const MapFrame::Placed& submap : frame_.submaps()) {
    const core::Vector3& t = submap.T_map_submap.translation;
    path.poses.push_back({submap.stamp, "", {t.x(), t.y(), t.z()}, core::xyzw(submap.T_map_submap.rotation)});
  }
  path.stamp = path.poses.back().stamp;
  publisher_->publish_poses(path);
}

/// Publishes map -> odom while a correction enters it.
void MapperLoop::publish_transform(Time now) {
  const core::Duration since = now - transform_at_;
  if (frame_.is_settled() || since < kTransformPeriod) return;
  transform_at_ = now;
  const core::SE3& T_map_odom = frame_.advance(keyframe_.T_odom_base, std::min(since, kLongestStep));
  if (publisher_) publisher_->publish_transform(keyframe_.stamp, T_map_odom);
}

void MapperLoop::publish_local_map(Time now) {
  if (!has_map_frame() || !local_map_changed_ || now < local_map_due_ ||
      publisher_->local_map_subscribers() == 0)
    return;
  local_map_due_ = now + kLocalMapPeriod;
  local_map_changed_ = false;
  const std::optional<mapping::Submap> local_map = builder_.local_map();
  if (!local_map) return;
  fill_points(*local_map, frame_.published() * local_map->T_odom_submap, points_);
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
