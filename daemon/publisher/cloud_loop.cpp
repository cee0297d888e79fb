#include "daemon/publisher/cloud_loop.hpp"

#include "nilio/core/clock.hpp"

#include <pthread.h>
#include <utility>

namespace nilio::dds {
namespace {

using core::Duration;
using core::Time;

// Subscribers are noticed, and poses of the path taken, this often.
constexpr Duration kPollPeriod{100'000'000};
constexpr Duration kPathPeriod{1'000'000'000};
constexpr Duration kInterfacePeriod{1'000'000'000};

}  // namespace

bool RateLimit::passes(Time stamp) {
  if (!last_ || stamp < *last_) due_ = stamp;
  last_ = stamp;
  // Half a period early is in time: due times keep the average, whatever the jitter of the stamps.
  if (stamp + Duration{period_.ns / 2} < due_) return false;
  due_ = due_ + period_;
  if (due_ <= stamp) due_ = stamp + period_;
  return true;
}

CloudLoop::CloudLoop(CloudInputs inputs, MakePublisher make_publisher, const CloudLimits& limits)
    : inputs_(std::move(inputs)),
      make_publisher_(std::move(make_publisher)),
      limits_(limits),
      scan_rate_(limits.scan_rate_max_hz) {
  inputs_.scans.set_wanted(false);
  inputs_.scans.skip_all();
  // Touched once: memory does not grow with the path.
  poses_.resize(limits_.path_poses);
  poses_.clear();
  // The path of the whole run, whatever a previous process has read of it.
  inputs_.path.rewind();
}

CloudLoop::~CloudLoop() { stop(); }

void CloudLoop::start(std::function<void()> prepare) {
  thread_ = std::thread([this, prepare = std::move(prepare)] {
    pthread_setname_np(pthread_self(), "clouds");
    prepare();
    publisher_ = make_publisher_();
    if (publisher_) run();
  });
}

void CloudLoop::stop() {
  if (!thread_.joinable()) return;
  stopping_.store(true);
  inputs_.wake.notify();
  thread_.join();
  inputs_.scans.set_wanted(false);
}

void CloudLoop::run() {
  Time next_refresh = monotonic_now() + kInterfacePeriod;
  while (!stopping_.load()) {
    inputs_.wake.wait(kPollPeriod);
    inputs_.scans.set_wanted(limits_.scan_points > 0 && publisher_->scan_subscribers() > 0);
    publish_scan();
    take_path();
    const Time now = monotonic_now();
    publish_path(now);
    if (now < next_refresh) continue;
    next_refresh = now + kInterfacePeriod;
    // A listed interface that appears restarts the process, by the participant of the poses.
    publisher_->participant().refresh_interfaces();
  }
}

void CloudLoop::count(bool accepted, std::atomic<std::uint64_t>& published) {
  (accepted ? published : failed_).fetch_add(1, std::memory_order_relaxed);
}

void CloudLoop::publish_scan() {
  if (!inputs_.scans.read_newest(*scan_) || !inputs_.scans.wanted()) return;
  if (!scan_rate_.passes({scan_->stamp_ns})) return;
  count(publisher_->publish_scan(*scan_, limits_.scan_points), scans_);
}

void CloudLoop::take_path() {
  ipc::PathPose pose;
  while (inputs_.path.read(pose)) {
    if (limits_.path_poses == 0) continue;
    if (poses_.size() < limits_.path_poses) {
      poses_.push_back(pose);
    } else {
      poses_[oldest_] = pose;
      oldest_ = (oldest_ + 1) % poses_.size();
    }
    path_changed_ = true;
  }
}

void CloudLoop::publish_path(Time now) {
  const int subscribers = publisher_->path_subscribers();
  // A new subscriber has received nothing yet.
  const bool is_new = subscribers > std::exchange(path_subscribers_, subscribers);
  if (is_new) path_changed_ = true;
  if (subscribers == 0 || poses_.empty() || !path_changed_ || now < path_due_) return;
  path_due_ = now + kPathPeriod;
  path_changed_ = false;
  path_.poses.resize(poses_.size());
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const ipc::PathPose& pose = poses_[(oldest_ + i) % poses_.size()];
    path_.poses[i].stamp = {pose.stamp_ns};
    path_.poses[i].position = pose.position;
    path_.poses[i].orientation_xyzw = pose.orientation_xyzw;
  }
  path_.stamp = path_.poses.back().stamp;
  count(publisher_->publish_path(path_), paths_);
}

CloudLoop::Counts CloudLoop::counts() const {
  return {scans_.load(std::memory_order_relaxed), paths_.load(std::memory_order_relaxed),
          failed_.load(std::memory_order_relaxed), inputs_.scans.dropped()};
}

}  // namespace nilio::dds
