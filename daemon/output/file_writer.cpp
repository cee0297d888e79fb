#include "daemon/output/file_writer.hpp"

#include "nilio/core/clock.hpp"

#include "daemon/realtime/thread_plan.hpp"
#include "ipc/ring.hpp"

#include <atomic>
#include <cstdio>
#include <ctime>
#include <future>
#include <pthread.h>
#include <sched.h>
#include <utility>

#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

// A minute and a half of poses at 10 Hz.
constexpr std::size_t kPoseSlots = 1024;
constexpr std::int64_t kDrainPeriodNs = 20'000'000;
// A write that takes longer is worth a line.
constexpr std::int64_t kSlowNs = 1'000'000'000;

/// Passes the values of a ring on.
template <class T, class Consume>
void drain(ipc::Ring<T>& ring, Consume consume) {
  for (std::span<const T> slots = ring.begin_read(); !slots.empty(); slots = ring.begin_read()) {
    for (const T& slot : slots) consume(slot);
    ring.consume(slots.size());
  }
}

}  // namespace

struct FileWriter::State {
  std::shared_ptr<Pipeline> pipeline;
  std::unique_ptr<RunOutput> output;
  std::unique_ptr<RunRecorder> recorder;
  ipc::Ring<ipc::PoseRecord> poses = ipc::Ring<ipc::PoseRecord>::in_private_memory(kPoseSlots);
  /// CLOCK_MONOTONIC of the work in progress; 0 = waiting for work.
  std::atomic<std::int64_t> busy_since_ns{0};
  std::atomic<std::uint64_t> lost{0};
  std::atomic<bool> ends{false};
  RunOutput::FinalFiles final_files;
  std::promise<Result<std::monostate>> finished;
  std::optional<PlanThread> thread;

  void run();
  void take_all(std::int64_t now_ns);
  void flush(std::int64_t now_ns);
};

void FileWriter::State::take_all(std::int64_t now_ns) {
  drain(poses, [&](const ipc::PoseRecord& record) {
    if (output) output->add(record);
  });
  // Decisions before packets: those of a recorded decision are then recorded, too.
  drain(pipeline->decisions(), [&](const ScanDecision& decision) {
    if (output) output->add(decision);
    if (recorder) recorder->add(decision);
  });
  drain(pipeline->clouds(), [&](const CloudRecord& cloud) {
    if (output) output->add(cloud);
  });
  if (output) output->take_submaps();
  if (!recorder) return;
  for (const auto& lidar : pipeline->lidars()) {
    if (!lidar->recorded) continue;
    drain(*lidar->recorded, [&](const drivers::Packet& packet) { recorder->add(packet, now_ns); });
  }
  if (ipc::Ring<drivers::CanFrame>* const frames = pipeline->recorded_frames()) {
    const std::string interface_name = pipeline->can_interface();
    drain(*frames, [&](const drivers::CanFrame& frame) { recorder->add(frame, interface_name, now_ns); });
  }
}

void FileWriter::State::flush(std::int64_t now_ns) {
  if (recorder) recorder->flush(now_ns);
  if (output) output->flush(now_ns);
  lost.store((recorder ? recorder->lost() : 0) + (output ? output->lost().total() : 0));
}

void FileWriter::State::run() {
  pthread_setname_np(pthread_self(), "nilio-files");
  const sched_param normal{};
  pthread_setschedparam(pthread_self(), SCHED_OTHER, &normal);
  std::int64_t flushed_ns = 0;
  while (!ends.load(std::memory_order_acquire)) {
    const timespec pause{0, kDrainPeriodNs};
    nanosleep(&pause, nullptr);
    const std::int64_t now = monotonic_ns();
    busy_since_ns.store(now);
    take_all(now);
    if (now - flushed_ns >= kFlushPeriod.ns) {
      flush(now);
      flushed_ns = now;
    }
    busy_since_ns.store(0);
  }
  const std::int64_t now = monotonic_ns();
  busy_since_ns.store(now);
  take_all(now);
  if (recorder) recorder->close(now);
  Result<std::monostate> result = std::monostate{};
  if (output) result = output->finish(final_files, now);
  if (result && recorder && recorder->lost() > 0)
    result = Error{std::to_string(recorder->lost()) +
                   " records of --record could not be written in time - the run can be repeated up to the "
                   "first of them only"};
  finished.set_value(std::move(result));
}

FileWriter::FileWriter(std::shared_ptr<Pipeline> pipeline, std::unique_ptr<RunOutput> output,
                       std::unique_ptr<RunRecorder> recorder)
    : state_(std::make_unique<State>()) {
  state_->pipeline = std::move(pipeline);
  state_->output = std::move(output);
  state_->recorder = std::move(recorder);
  state_->thread.emplace([state = state_.get()] { state->run(); });
}

FileWriter::~FileWriter() {
  if (!state_ || !state_->thread) return;
  state_->ends.store(true, std::memory_order_release);
  state_->thread->join();
}

bool FileWriter::has_room() const { return state_->poses.size() < state_->poses.capacity(); }

void FileWriter::add(const ipc::PoseRecord& record) { state_->poses.try_push(record); }

std::optional<std::string> FileWriter::poll(std::int64_t now_ns) {
  const std::int64_t busy_since = state_->busy_since_ns.load();
  const bool is_slow = busy_since > 0 && now_ns - busy_since > kSlowNs;
  if (is_slow && slow_since_ns_ == 0) {
    slow_since_ns_ = busy_since;
    return "files: the disk has taken no data for 1 s - poses continue; check the disk of --output and "
           "--record";
  }
  // The same write still runs.
  if (slow_since_ns_ == 0 || busy_since == slow_since_ns_) return std::nullopt;
  std::array<char, 160> line{};
  const Counters dropped = counters();
  std::snprintf(line.data(), line.size(),
                "files: the disk takes data again after %.1f s; %llu poses, %llu decisions and %llu packets "
                "dropped so far",
                static_cast<double>(now_ns - std::exchange(slow_since_ns_, 0)) * 1e-9,
                static_cast<unsigned long long>(dropped.poses_dropped),
                static_cast<unsigned long long>(dropped.decisions_dropped),
                static_cast<unsigned long long>(dropped.packets_dropped));
  return line.data();
}

Result<std::monostate> FileWriter::finish(RunOutput::FinalFiles final_files, core::Duration patience) {
  state_->final_files = std::move(final_files);
  std::future<Result<std::monostate>> finished = state_->finished.get_future();
  state_->ends.store(true, std::memory_order_release);
  if (finished.wait_for(std::chrono::nanoseconds(patience.ns)) == std::future_status::ready) {
    state_->thread->join();
    state_->thread.reset();
    return finished.get();
  }
  // The thread waits in the kernel and cannot be ended: its memory stays until the process ends.
  static_cast<void>(state_.release());
  return Error{"files: the disk did not take the last data within " +
               std::to_string(patience.ns / 1'000'000) +
               " ms; the files of this run are incomplete - check the disk"};
}

FileWriter::Counters FileWriter::counters() const {
  Counters counters;
  const Pipeline& pipeline = *state_->pipeline;
  counters.poses_dropped = state_->poses.dropped();
  counters.decisions_dropped = pipeline.decisions().dropped();
  counters.clouds_dropped = pipeline.clouds().dropped();
  for (const auto& lidar : pipeline.lidars())
    counters.packets_dropped += lidar->recorded ? lidar->recorded->dropped() : 0;
  if (pipeline.recorded_frames() != nullptr) counters.frames_dropped = pipeline.recorded_frames()->dropped();
  counters.disk_lost = state_->lost.load();
  return counters;
}

}  // namespace nilio::daemon
