#include "daemon/mapper/localisation_thread.hpp"

#include "nilio/core/clock.hpp"

#include <array>
#include <chrono>
#include <cstdio>
#include <memory>
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>
#include <utility>

#include "mapping/map_folder.hpp"
#include "mapping/map_recovery.hpp"

namespace nilio::daemon {
namespace {

constexpr int kLocalisationNice = 10;
// About 10 MB of keyframes.
constexpr std::size_t kQueue = 64;
constexpr core::Duration kRecoveryPatience = core::Duration::from_seconds(5.0);
constexpr std::chrono::milliseconds kRecoveryInterval{200};

std::string text_of(const mapping::MapId& id) {
  std::string text;
  for (std::size_t i = 0; i < id.size(); ++i) {
    std::array<char, 4> digits{};
    std::snprintf(digits.data(), digits.size(), "%02x", id[i]);
    if (i == 4 || i == 6 || i == 8 || i == 10) text += '-';
    text += digits.data();
  }
  return text;
}

}  // namespace

LocalisationThread::LocalisationThread(LocalisationThreadConfig config)
    : config_(std::move(config)), thread_([this] { run(); }) {}

LocalisationThread::~LocalisationThread() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

bool LocalisationThread::add(const mapping::Keyframe& keyframe) {
  {
    const std::lock_guard lock(mutex_);
    if (has_failed_) return true;
    if (config_.keeps_all && queue_.size() >= kQueue) return false;
    queue_.push_back(keyframe);
    if (queue_.size() > kQueue) {
      queue_.pop_front();
      dropped_.fetch_add(1);
    }
  }
  changed_.notify_one();
  return true;
}

std::vector<mapping::Localisation> LocalisationThread::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(results_, {});
}

bool LocalisationThread::is_done() const {
  const std::lock_guard lock(mutex_);
  return has_failed_ || queue_.empty();
}

std::optional<LocalisationThread::Loaded> LocalisationThread::take_loaded() {
  const std::lock_guard lock(mutex_);
  return std::exchange(loaded_, std::nullopt);
}

/// Completes the map; its mapper may be about to end.
void LocalisationThread::recover() const {
  for (std::int64_t end_ns = monotonic_ns() + kRecoveryPatience.ns; monotonic_ns() < end_ns;
       std::this_thread::sleep_for(kRecoveryInterval)) {
    if (mapping::recover_map(config_.map, {clock_ns(CLOCK_REALTIME)}) || ends()) return;
  }
}

bool LocalisationThread::ends() const {
  const std::lock_guard lock(mutex_);
  return ends_;
}

/// Empty if the map cannot be used, or the thread has to end.
std::optional<mapping::SavedMap> LocalisationThread::load() {
  const std::int64_t begin_ns = monotonic_ns();
  if (config_.continues_run) recover();
  auto opened = mapping::MapReader::open(config_.map);
  const auto finish = [this](bool ok, std::string message) {
    const std::lock_guard lock(mutex_);
    loaded_ = Loaded{std::move(message), ok};
    has_failed_ = !ok;
    if (!ok) queue_.clear();
  };
  const std::string folder = config_.map.string();
  if (!opened) {
    finish(false, opened.error().message);
    return std::nullopt;
  }
  const auto reader = std::make_shared<mapping::MapReader>(std::move(opened).value());
  if (reader->submaps().empty()) {
    finish(false, folder + ": the map has no submaps - name the map of a complete run, or complete it with " +
                      "nilio map recover");
    return std::nullopt;
  }
  const auto damage = std::make_shared<std::string>(reader->warning());
  const auto unreadable = std::make_shared<std::size_t>(0);
  mapping::SavedMap map(reader->submaps(), [reader, damage, unreadable](const mapping::SubmapEntry& entry) {
    auto submap = reader->load(entry);
    if (submap) return std::optional(std::move(submap).value());
    if (damage->empty()) *damage = submap.error().message;
    ++*unreadable;
    return std::optional<mapping::Submap>();
  });
  while (map.prepare_next()) {
    if (ends()) return std::nullopt;
  }
  if (config_.continues_run) last_pose_ = mapping::last_pose(*reader);
  if (map.is_empty()) {
    finish(false, *damage + "; no submap of the map can be read - use a copy of the map");
    return std::nullopt;
  }
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), ": map %s, %zu submaps, loaded in %.1f s",
                text_of(reader->header().id).c_str(), reader->submaps().size(),
                static_cast<double>(monotonic_ns() - begin_ns) * 1e-9);
  finish(true, folder + text.data() + (damage->empty() ? "" : "; damaged in part: " + *damage));
  return map;
}

void LocalisationThread::run() {
  pthread_setname_np(pthread_self(), "nilio-localise");
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kLocalisationNice);
  const std::optional<mapping::SavedMap> map = load();
  if (!map) return;
  mapping::Localiser localiser(*map, config_.range_m, last_pose_);
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return ends_ || !queue_.empty(); });
    if (ends_) return;
    const mapping::Keyframe keyframe = queue_.front();
    lock.unlock();
    const mapping::Localisation result = localiser.add(keyframe);
    lock.lock();
    results_.push_back(result);
    // It stays in the queue until it has a result.
    if (!queue_.empty() && queue_.front().stamp == keyframe.stamp) queue_.pop_front();
  }
}

}  // namespace nilio::daemon
