#include "daemon/mapper/loop_thread.hpp"

#include <algorithm>
#include <iterator>
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

namespace nilio::daemon {
namespace {

// Keyframes, and odometry without real-time priority, come first.
constexpr int kLoopNice = 10;
constexpr std::size_t kNamedLoops = 3;

using Pairs = std::vector<std::pair<std::uint32_t, std::uint32_t>>;

/// "loop 40-3, 41-4 and 2 more"
std::string names_of(const Pairs& loops) {
  std::string text = "loop";
  for (std::size_t i = 0; i < std::min(loops.size(), kNamedLoops); ++i)
    text += (i > 0 ? ", " : " ") + std::to_string(loops[i].first) + "-" + std::to_string(loops[i].second);
  if (loops.size() > kNamedLoops) text += " and " + std::to_string(loops.size() - kNamedLoops) + " more";
  return text;
}

/// Loops of complete searches. The place of the last submap lacks a neighbour and is searched again.
std::vector<mapping::Loop> known_loops(const mapping::MapReader& map) {
  std::vector<mapping::Loop> loops = map.loops();
  std::erase_if(loops, [&](const mapping::Loop& loop) { return loop.moving >= map.last_corrected(); });
  return loops;
}

}  // namespace

LoopThread::LoopThread(const mapping::MapWriter& writer)
    : writer_(writer),
      last_known_(writer.content().last_corrected()),
      known_(known_loops(writer.content())),
      closer_([this](std::uint32_t id) { return load(id); }),
      thread_([this] { run(); }) {}

LoopThread::~LoopThread() {
  {
    const std::lock_guard lock(mutex_);
    ends_ = true;
  }
  changed_.notify_one();
  thread_.join();
}

void LoopThread::add(const mapping::SubmapEntry& entry) {
  {
    const std::lock_guard lock(mutex_);
    queue_.push_back(entry);
  }
  changed_.notify_one();
}

void LoopThread::finish() {
  {
    const std::lock_guard lock(mutex_);
    finishes_ = true;
  }
  changed_.notify_one();
}

bool LoopThread::is_done() const {
  const std::lock_guard lock(mutex_);
  return is_done_;
}

std::size_t LoopThread::waiting() const {
  const std::lock_guard lock(mutex_);
  return queue_.size();
}

std::optional<LoopUpdate> LoopThread::take() {
  const std::lock_guard lock(mutex_);
  return std::exchange(update_, std::nullopt);
}

std::optional<std::string> LoopThread::take_failure() {
  const std::lock_guard lock(mutex_);
  return std::exchange(failure_, std::nullopt);
}

void LoopThread::run() {
  pthread_setname_np(pthread_self(), "nilio-loops");
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kLoopNice);
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [&] { return ends_ || !queue_.empty() || (finishes_ && !is_done_); });
    if (ends_) return;
    // It stays in the queue until its loops are on disk.
    const std::optional<mapping::SubmapEntry> entry =
        queue_.empty() ? std::nullopt : std::optional(queue_.front());
    lock.unlock();
    work(entry ? &*entry : nullptr);
    lock.lock();
    if (entry)
      queue_.pop_front();
    else
      is_done_ = true;
  }
}

/// Null: the end of the drive.
void LoopThread::work(const mapping::SubmapEntry* entry) {
  const bool is_known = entry != nullptr && last_known_ && entry->id <= *last_known_;
  if (entry != nullptr) {
    entries_.push_back(*entry);
    const std::optional<mapping::Submap> submap = load(entry->id);
    if (!submap) return entries_.pop_back();
    closer_.add(*submap, is_known ? &known_ : nullptr);
  } else {
    closer_.finish();
  }
  const std::string change = describe_change();
  // The file has more than that.
  if (is_known) return;
  const mapping::MapCorrection correction = correction_of(closer_);
  if (const auto written = writer_.write(correction); !written) fail(written.error().message);
  const std::lock_guard lock(mutex_);
  const std::string earlier = update_ ? update_->cause : "";
  update_ = LoopUpdate{correction.poses, closer_.T_map_odom(), closer_.accepted(),
                       earlier + (earlier.empty() || change.empty() ? "" : "; ") + change};
}

std::optional<mapping::Submap> LoopThread::load(std::uint32_t id) {
  const auto entry = std::lower_bound(entries_.begin(), entries_.end(), id,
                                      [](const auto& e, std::uint32_t wanted) { return e.id < wanted; });
  if (entry == entries_.end() || entry->id != id) return std::nullopt;
  auto submap = writer_.content().load(*entry);
  if (submap) return std::move(submap).value();
  fail(submap.error().message);
  return std::nullopt;
}

void LoopThread::fail(const std::string& message) {
  const std::lock_guard lock(mutex_);
  failure_ = message;
}

/// Changes of the accepted loops since the last call.
std::string LoopThread::describe_change() {
  Pairs accepted;
  for (const mapping::Loop& loop : closer_.loops()) {
    if (loop.verdict == mapping::LoopVerdict::kAccepted) accepted.emplace_back(loop.moving, loop.reference);
  }
  std::sort(accepted.begin(), accepted.end());
  const Pairs before = std::exchange(accepted_, accepted);
  Pairs added;
  Pairs removed;
  std::set_difference(accepted.begin(), accepted.end(), before.begin(), before.end(),
                      std::back_inserter(added));
  std::set_difference(before.begin(), before.end(), accepted.begin(), accepted.end(),
                      std::back_inserter(removed));
  std::string text = added.empty() ? "" : names_of(added);
  if (!removed.empty()) text += (text.empty() ? "" : "; ") + names_of(removed) + " given up";
  return text;
}

}  // namespace nilio::daemon
