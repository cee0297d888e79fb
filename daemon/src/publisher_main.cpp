// nilio-publisher: takes poses from the ring that niliod shares with it and speaks DDS. It is a process of
// its own so that nothing that Fast DDS does (abort on a malformed datagram, allocate, block) can touch the
// estimator.

#include "nilio/core/time.hpp"
#include "nilio/dds/diagnostics.hpp"
#include "nilio/dds/odometry_publisher.hpp"
#include "nilio/ipc/histogram.hpp"
#include "nilio/ipc/pose_record.hpp"
#include "nilio/ipc/ring.hpp"
#include "nilio/ipc/wake_event.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstring>
#include <ctime>
#include <memory>
#include <optional>
#include <poll.h>
#include <string>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

#include <CLI/CLI.hpp>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

namespace nilio::daemon {
namespace {

using core::Duration;
using core::Time;

constexpr int kExitFailed = 1;
constexpr int kExitStartAgain = 75;  // EX_TEMPFAIL of sysexits.h
constexpr Duration kReportPeriod{1'000'000'000};
// Together less than the 2 s that niliod waits for the end of this process.
constexpr Duration kMaxWaitWhenStopping{1'000'000'000};
constexpr Duration kLastAcknowledgments{500'000'000};
// What a reliable subscriber may take to acknowledge when poses come faster than the history is deep.
constexpr Duration kBacklogAcknowledgment{20'000'000};

struct Options {
  int ring_descriptor = -1;
  int wake_descriptor = -1;
  pid_t parent = 0;
  int nice = 0;
  double wait_for_subscribers_s = 0.0;
  dds::OdometryPublisherConfig publisher;
};

Time read_clock(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return {static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec};
}
Time monotonic_now() { return read_clock(CLOCK_MONOTONIC); }

Time stage_time(const ipc::PoseRecord& record, ipc::Stage stage) {
  return {record.stage_ns[static_cast<std::size_t>(stage)]};
}

/// Where the time goes, up to the return of write().
class PublishLatency {
 public:
  void record(const ipc::PoseRecord& record, Time taken, Time written) noexcept {
    stages_.record(record);
    write_.record((written - taken).ns);
    const Time handed_over = stage_time(record, ipc::Stage::kHandedOver);
    if (handed_over.ns != 0) pick_up_.record((taken - handed_over).ns);
    const Time received = stage_time(record, ipc::Stage::kReceived);
    if (received.ns != 0)
      received_to_written_.record_corrected((written - received).ns, record.stamp_ns - record.scan_start_ns);
  }

  [[nodiscard]] std::vector<ipc::LatencySummary> summaries() const {
    std::vector<ipc::LatencySummary> summaries = stages_.summaries();
    summaries.push_back(ipc::summarize("pick_up", pick_up_));
    summaries.push_back(ipc::summarize("write", write_));
    summaries.push_back(ipc::summarize("received_to_written", received_to_written_));
    return summaries;
  }

 private:
  ipc::LatencyHistograms stages_;
  ipc::Histogram pick_up_;
  ipc::Histogram write_;
  ipc::Histogram received_to_written_;
};

/// The loop between the ring and DDS.
class PublisherLoop {
 public:
  PublisherLoop(const Options& options, ipc::Ring<ipc::PoseRecord> ring, ipc::WakeEvent wake_event,
                int signals, std::unique_ptr<dds::OdometryPublisher> publisher)
      : parent_(options.parent),
        ring_(std::move(ring)),
        wake_event_(std::move(wake_event)),
        signals_(signals),
        publisher_(std::move(publisher)),
        latency_(std::make_unique<PublishLatency>()) {}

  /// Returns the exit status.
  int run(Duration wait_for_subscribers) {
    wait_for_first_subscriber(wait_for_subscribers);
    next_report_ = monotonic_now();
    while (true) {
      publish_pending();
      if (stopping_ && ring_.size() == 0) break;
      if (monotonic_now() >= next_report_ && !report()) return kExitStartAgain;
      if (!stopping_ && ring_.size() == 0) sleep_until(next_report_);
    }
    publish_reports();
    const bool acknowledged = publisher_->wait_for_acknowledgments(kLastAcknowledgments);
    spdlog::info("stopped: {} poses published, {} writes failed{}", published_, failed_,
                 acknowledged ? "" : ", not all acknowledged by every subscriber");
    return 0;
  }

 private:
  // Until a subscriber has the first pose, the wait is over, or (somewhat later) somebody wants us to end.
  void wait_for_first_subscriber(Duration wait) {
    Time deadline = monotonic_now() + wait;
    bool shortened = false;
    while (!is_first_pose_delivered() && monotonic_now() < deadline) {
      pollfd waited{signals_, POLLIN, 0};
      poll(&waited, stopping_ ? 0 : 1, 10);
      note_signals();
      if (stopping_ && !shortened) {
        deadline = std::min(deadline, monotonic_now() + kMaxWaitWhenStopping);
        shortened = true;
      }
    }
    if (wait.ns > 0)
      spdlog::info("{} subscriber(s) found, {} poses waiting", publisher_->subscribers(), ring_.size());
  }

  // That a subscriber is found does not mean that it has found us: until then it gets nothing, and the
  // history that is kept for it is short. So the first pose goes alone, and the others follow once it is
  // acknowledged.
  bool is_first_pose_delivered() {
    if (publisher_->subscribers() == 0) return false;
    if (published_ == 0) {
      const auto records = ring_.begin_read();
      if (records.empty()) return stopping_;
      publish(records.front());
      ring_.consume(1);
    }
    return publisher_->wait_for_acknowledgments(kBacklogAcknowledgment);
  }

  void publish_pending() {
    // A pose is given back only when written, so that a successor of this process would write it again.
    int in_a_row = 0;
    for (auto records = ring_.begin_read(); !records.empty(); records = ring_.begin_read()) {
      publish(records.front());
      ring_.consume(1);
      if (++in_a_row < dds::OdometryPublisher::kHistoryDepth - 2) continue;
      // A backlog: without a pause the history would overwrite what reliable subscribers have not got yet.
      publisher_->wait_for_acknowledgments(kBacklogAcknowledgment);
      in_a_row = 0;
      note_signals();
      if (monotonic_now() >= next_report_) return;
    }
  }

  void publish(const ipc::PoseRecord& record) {
    const Time taken = monotonic_now();
    const bool odometry_written = publisher_->publish_odometry(record);
    const Time written = monotonic_now();
    const bool transform_written = publisher_->publish_transform(record);
    latency_->record(record, taken, written);
    latest_ = record;
    latest_taken_ = taken;
    ++published_;
    const std::uint64_t failed = (odometry_written ? 0U : 1U) + (transform_written ? 0U : 1U);
    if (failed > 0 && failed_ == 0)
      spdlog::error("Fast DDS refused to write pose {}; further failures are counted in the latency report",
                    record.sequence);
    failed_ += failed;
  }

  // False when only a new process can go on.
  bool report() {
    next_report_ = std::max(next_report_ + kReportPeriod, monotonic_now());
    publish_reports();
    if (parent_ != 0 && getppid() != parent_) {
      spdlog::warn("niliod (process {}) is gone", parent_);
      stopping_ = true;
    }
    switch (publisher_->participant().refresh_interfaces()) {
      case dds::Participant::Refresh::kUnchanged:
        return true;
      case dds::Participant::Refresh::kRescanned:
        spdlog::info("the network interfaces have changed: DDS uses them as they are now");
        return true;
      case dds::Participant::Refresh::kNeedsRestart:
        spdlog::info("a DDS interface from the list has appeared: starting again to use it");
        return false;
    }
    return true;
  }

  void publish_reports() {
    publisher_->publish_latency(latency_report());
    if (!latest_) return;
    publisher_->publish_diagnostics(
        dds::make_diagnostics(*latest_, read_clock(CLOCK_REALTIME), monotonic_now() - latest_taken_));
  }

  [[nodiscard]] dds::LatencyReport latency_report() const {
    dds::LatencyReport report;
    report.stamp = read_clock(CLOCK_REALTIME);
    for (const ipc::LatencySummary& stage : latency_->summaries())
      report.stages.push_back({stage.name, stage.count, stage.p50_us, stage.p99_us, stage.max_us});
    report.poses_published = published_;
    report.failed_writes = failed_;
    report.ring_dropped = ring_.dropped();
    report.ring_high_water = ring_.high_water();
    return report;
  }

  void sleep_until(Time time) {
    std::array<pollfd, 2> waited{pollfd{wake_event_.file_descriptor(), POLLIN, 0},
                                 pollfd{signals_, POLLIN, 0}};
    const Duration left = std::max(time - monotonic_now(), Duration{0});
    const timespec timeout{left.ns / 1'000'000'000, left.ns % 1'000'000'000};
    ppoll(waited.data(), waited.size(), &timeout, nullptr);
    wake_event_.clear();
    note_signals();
  }

  void note_signals() {
    signalfd_siginfo signal{};
    while (read(signals_, &signal, sizeof signal) == sizeof signal) stopping_ = true;
  }

  pid_t parent_;
  ipc::Ring<ipc::PoseRecord> ring_;
  ipc::WakeEvent wake_event_;
  int signals_;
  std::unique_ptr<dds::OdometryPublisher> publisher_;
  std::unique_ptr<PublishLatency> latency_;
  std::optional<ipc::PoseRecord> latest_;
  Time latest_taken_;
  Time next_report_;
  std::uint64_t published_ = 0;
  std::uint64_t failed_ = 0;
  bool stopping_ = false;
};

// Blocks SIGTERM and SIGINT (in this thread and in those of Fast DDS, made later) and makes a descriptor of
// them.
int take_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGTERM);
  sigaddset(&signals, SIGINT);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  return signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
}

// False when the parent is already gone.
bool end_with_parent(pid_t parent) {
  if (parent == 0) return true;
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  return getppid() == parent;
}

int run(const Options& options) {
  const int signals = take_signals();
  if (signals < 0) {
    spdlog::critical("signalfd: {}", std::strerror(errno));
    return kExitFailed;
  }
  if (!end_with_parent(options.parent)) {
    spdlog::error("process {}, which --parent-pid names, is not the parent of this one: not starting",
                  options.parent);
    return kExitFailed;
  }
  // The threads of Fast DDS inherit it.
  if (options.nice != 0 && setpriority(PRIO_PROCESS, 0, options.nice) != 0)
    spdlog::warn("no privilege for nice {} (CAP_SYS_NICE or LimitNICE= in the unit): running at 0",
                 options.nice);

  auto ring = ipc::Ring<ipc::PoseRecord>::attach(options.ring_descriptor);
  auto wake_event = ipc::WakeEvent::adopt(options.wake_descriptor);
  if (!ring || !wake_event) {
    spdlog::critical("what niliod should have handed over is not there: {}",
                     ring ? wake_event.error().message : ring.error().message);
    return kExitFailed;
  }
  dds::set_fastdds_log_handler([](const std::string& line) { spdlog::warn("{}", line); });
  auto publisher = dds::OdometryPublisher::create(options.publisher);
  if (!publisher) {
    spdlog::critical("{}", publisher.error().message);
    return kExitFailed;
  }
  for (const std::string& address : (*publisher)->participant().missing_interfaces())
    spdlog::warn("DDS interface {} is not on this machine (yet): not used", address);
  spdlog::info("publishing on DDS domain {}", options.publisher.participant.domain);
  PublisherLoop loop(options, std::move(ring).value(), std::move(wake_event).value(), signals,
                     std::move(publisher).value());
  return loop.run(Duration::from_seconds(options.wait_for_subscribers_s));
}

void add_options(CLI::App& app, Options& options) {
  dds::OdometryPublisherConfig& publisher = options.publisher;
  app.add_option("--ring-fd", options.ring_descriptor, "Inherited memfd of the pose ring")->required();
  app.add_option("--wake-fd", options.wake_descriptor, "Inherited eventfd, signalled when there are poses")
      ->required();
  app.add_option("--parent-pid", options.parent, "End when this process, the parent, does");
  app.add_option("--domain", publisher.participant.domain, "DDS domain id")->check(CLI::Range(0, 232));
  app.add_option("--interface", publisher.participant.interface_whitelist,
                 "IPv4 address of an interface DDS may use (repeatable; default: all)");
  app.add_option("--odom-frame", publisher.odom_frame, "Frame of the poses");
  app.add_option("--base-frame", publisher.base_frame, "Frame of the vehicle");
  app.add_option("--topic-prefix", publisher.topic_prefix, "Put before the topic names");
  app.add_option("--nice", options.nice, "Scheduling priority of this process")->check(CLI::Range(-20, 19));
  app.add_option("--wait-for-subscribers", options.wait_for_subscribers_s,
                 "Seconds to wait for a first subscriber before reading the ring")
      ->check(CLI::Range(0.0, 3600.0));
}

}  // namespace
}  // namespace nilio::daemon

int main(int argc, char** argv) {
  CLI::App app{"Publishes the poses of niliod over DDS. Started by niliod."};
  nilio::daemon::Options options;
  options.publisher.participant.name = "nilio";
  nilio::daemon::add_options(app, options);
  CLI11_PARSE(app, argc, argv);
  spdlog::set_default_logger(spdlog::stderr_logger_mt("nilio-publisher"));
  spdlog::set_pattern("%Y-%m-%dT%H:%M:%S.%e %l %n: %v");
  return nilio::daemon::run(options);
}
