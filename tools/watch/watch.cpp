#include "tools/watch/watch.hpp"

#include "nilio/core/time.hpp"
#include "nilio/core/units.hpp"

#include "ipc/dds/reports.hpp"
#include "ipc/histogram.hpp"
#include "tools/watch/packet_to_pose.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <deque>
#include <fstream>
#include <functional>
#include <memory>
#include <optional>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::watch {

namespace {

using core::Duration;
using Clock = std::chrono::steady_clock;

constexpr Duration kPollPeriod{50'000'000};
constexpr std::chrono::milliseconds kTerminalPeriod{100};
constexpr std::chrono::seconds kLinePeriod{1};
constexpr std::chrono::seconds kRateWindow{2};

bool is_finite(const dds::Odometry& message) {
  const auto finite = [](double number) { return std::isfinite(number); };
  return std::all_of(message.position.begin(), message.position.end(), finite) &&
         std::all_of(message.orientation_xyzw.begin(), message.orientation_xyzw.end(), finite);
}

double yaw_deg(const std::array<double, 4>& q) {
  return kDegreesPerRadian *
         std::atan2(2.0 * (q[3] * q[2] + q[0] * q[1]), 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2]));
}

double norm(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }

// Writes poses as lines of "time x y z qx qy qz qw" (TUM trajectory format).
class TumFile {
 public:
  TumFile() = default;
  TumFile(const TumFile&) = delete;
  TumFile& operator=(const TumFile&) = delete;
  ~TumFile() { close(); }

  bool open(const std::string& path) {
    file_ = std::fopen(path.c_str(), "we");
    return file_ != nullptr;
  }

  void write(const dds::Odometry& message) {
    if (file_ == nullptr) return;
    const std::int64_t ns = message.stamp.ns;
    const auto& p = message.position;
    const auto& q = message.orientation_xyzw;
    std::fprintf(file_, "%lld.%09lld %.9f %.9f %.9f %.12f %.12f %.12f %.12f\n",
                 static_cast<long long>(ns / kNanosecondsPerSecond),
                 static_cast<long long>(std::abs(ns % kNanosecondsPerSecond)), p[0], p[1], p[2], q[0], q[1],
                 q[2], q[3]);
  }

  // False on a write error.
  bool close() {
    if (file_ == nullptr) return true;
    const bool written = std::ferror(file_) == 0;
    return std::fclose(std::exchange(file_, nullptr)) == 0 && written;
  }

 private:
  std::FILE* file_ = nullptr;
};

class WatchStatistics {
 public:
  void add(const dds::ReceivedOdometry& sample) {
    const auto now = Clock::now();
    if (poses_ == 0) first_ = now;
    last_ = now;
    ++poses_;
    arrivals_.push_back(now);
    while (now - arrivals_.front() > kRateWindow) arrivals_.pop_front();
    const Duration delay = sample.received - sample.written;
    if (delay.ns < 0) ++from_the_future_;
    latency_->record(delay.ns);
    packet_to_pose_.add_pose(sample.message.stamp, sample.received_ns);
    if (!is_finite(sample.message)) {
      ++not_finite_;
      return;
    }
    const auto& p = sample.message.position;
    if (latest_) {
      const auto& before = latest_->position;
      path_m_ += norm({p[0] - before[0], p[1] - before[1], p[2] - before[2]});
    }
    latest_ = sample.message;
  }

  void add(const dds::ScanReport& report) { packet_to_pose_.add_report(report); }

  // Rate over the last two seconds.
  [[nodiscard]] double rate_hz() const {
    if (arrivals_.size() < 2 || Clock::now() - arrivals_.back() > kRateWindow) return 0.0;
    const std::chrono::duration<double> span = arrivals_.back() - arrivals_.front();
    return span.count() > 0.0 ? static_cast<double>(arrivals_.size() - 1) / span.count() : 0.0;
  }

  [[nodiscard]] std::string status_line(const dds::SubscriberCounts& counts) const {
    std::array<char, 320> line{};
    if (!latest_) {
      std::snprintf(line.data(), line.size(), "waiting: %d publisher(s) found, no pose yet",
                    counts.publishers);
      return line.data();
    }
    const dds::Odometry& pose = *latest_;
    const ipc::HistogramSnapshot latency = latency_->snapshot();
    std::snprintf(
        line.data(), line.size(),
        "x %.2f y %.2f z %.2f m  yaw %.1f deg  %.2f m/s  %.1f Hz  dds p50 %.0f p99 %.0f us  %llu received, "
        "%llu lost",
        pose.position[0], pose.position[1], pose.position[2], yaw_deg(pose.orientation_xyzw),
        norm(pose.linear_velocity), rate_hz(), static_cast<double>(latency.percentile(50.0)) * 1e-3,
        static_cast<double>(latency.percentile(99.0)) * 1e-3,
        static_cast<unsigned long long>(counts.received), static_cast<unsigned long long>(counts.lost));
    return line.data();
  }

  void print_summary(const dds::SubscriberCounts& counts) const {
    const std::chrono::duration<double> span = last_ - first_;
    const double rate =
        poses_ > 1 && span.count() > 0.0 ? static_cast<double>(poses_ - 1) / span.count() : 0.0;
    std::printf("poses received  %llu in %.2f s, %.2f Hz\n", static_cast<unsigned long long>(poses_),
                span.count(), rate);
    std::printf("lost            %llu on the way, %llu here\n", static_cast<unsigned long long>(counts.lost),
                static_cast<unsigned long long>(counts.queue_dropped));
    if (counts.writers_seen > 1)
      std::printf("publishers      %llu: started again, or several at once\n",
                  static_cast<unsigned long long>(counts.writers_seen));
    std::printf("path length     %.3f m\n", path_m_);
    print_latency("write to here", ipc::summarize("write_to_here", *latency_));
    const auto from_packet = ipc::summarize("packet_to_here", packet_to_pose_.histogram());
    if (from_packet.count > 0) {
      print_latency("packet to here", from_packet);
    } else if (packet_to_pose_.of_other_machines() > 0) {
      std::printf("packet to here  unknown: niliod runs on another machine with its own clock\n");
    }
    if (from_the_future_ > 0)
      std::printf(
          "                %llu arrived before they were written: the clocks of the machines differ\n",
          static_cast<unsigned long long>(from_the_future_));
    if (not_finite_ > 0)
      std::printf("not finite      %llu poses: left out of path and file\n",
                  static_cast<unsigned long long>(not_finite_));
  }

  [[nodiscard]] nlohmann::json json(const dds::SubscriberCounts& counts) const {
    nlohmann::json json = {{"poses", poses_},
                           {"seconds", std::chrono::duration<double>(last_ - first_).count()},
                           {"lost", counts.lost},
                           {"queue_dropped", counts.queue_dropped},
                           {"publishers", counts.writers_seen},
                           {"path_length_m", path_m_},
                           {"not_finite", not_finite_}};
    json["latency"] = ipc::latency_json({ipc::summarize("write_to_here", *latency_),
                                         ipc::summarize("packet_to_here", packet_to_pose_.histogram())});
    return json;
  }

  [[nodiscard]] std::uint64_t poses() const { return poses_; }

 private:
  static void print_latency(const char* name, const ipc::LatencySummary& latency) {
    std::printf("%-15s p50 %.0f  p90 %.0f  p99 %.0f  p99.9 %.0f  max %.0f us\n", name, latency.p50_us,
                latency.p90_us, latency.p99_us, latency.p99_9_us, latency.max_us);
  }

  std::uint64_t poses_ = 0;
  std::uint64_t not_finite_ = 0;
  std::uint64_t from_the_future_ = 0;
  double path_m_ = 0.0;
  std::optional<dds::Odometry> latest_;
  Clock::time_point first_;
  Clock::time_point last_;
  std::deque<Clock::time_point> arrivals_;
  std::unique_ptr<ipc::Histogram> latency_ = std::make_unique<ipc::Histogram>();
  PacketToPose packet_to_pose_{dds::read_host_id()};
};

// Status line: rewritten in place on a terminal, otherwise one line per second.
class StatusLine {
 public:
  void show(const std::function<std::string()>& text) {
    const auto now = Clock::now();
    if (now < next_) return;
    if (terminal_) {
      std::printf("\r\033[K%s", text().c_str());
      next_ = now + kTerminalPeriod;
    } else {
      std::printf("%s\n", text().c_str());
      next_ = now + kLinePeriod;
    }
    std::fflush(stdout);
  }
  void finish() const {
    if (terminal_) std::printf("\n");
  }

 private:
  bool terminal_ = isatty(STDOUT_FILENO) == 1;
  Clock::time_point next_ = Clock::now() + (terminal_ ? Clock::duration{0} : Clock::duration{kLinePeriod});
};

// Blocks SIGINT and SIGTERM, in the threads of DDS too, and returns a descriptor for them, so that the
// summary is still printed.
int take_signals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  return signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
}

bool is_interrupted(int signals) {
  signalfd_siginfo signal{};
  return read(signals, &signal, sizeof signal) == sizeof signal;
}

// Receives until a signal, `count`, or the time-out.
void receive(const Options& options, int signals, dds::OdometrySubscriber& subscriber, TumFile& tum,
             WatchStatistics& statistics) {
  StatusLine status_line;
  auto last_sample = Clock::now();
  while (!is_interrupted(signals)) {
    if (const auto sample = subscriber.next(kPollPeriod)) {
      last_sample = Clock::now();
      statistics.add(*sample);
      if (is_finite(sample->message)) tum.write(sample->message);
      if (options.count > 0 && statistics.poses() >= options.count) break;
    } else if (options.timeout_s > 0.0 &&
               Clock::now() - last_sample > std::chrono::duration<double>(options.timeout_s)) {
      break;
    }
    for (const dds::ScanReport& report : subscriber.scan_reports()) statistics.add(report);
    status_line.show([&] { return statistics.status_line(subscriber.counts()); });
  }
  status_line.finish();
}

int explain_silence(const Options& options, int publishers) {
  std::string topic = "rt/odom";
  if (const auto names = dds::topic_names(options.subscriber.topic_prefix))
    topic = options.subscriber.imu_rate ? names->imu_odometry : names->odometry;
  std::fprintf(
      stderr,
      "nilio watch: no pose received on %s, domain %u, %d publisher(s) found.\nCheck: is niliod running and "
      "tracking? Is --domain the one of its configuration? Does --interface name this machine's own address "
      "on "
      "the network to it (or leave it out)? Does a firewall let UDP %u to %u through?\n",
      topic.c_str(), options.subscriber.participant.domain, publishers,
      7400 + 250 * options.subscriber.participant.domain, 7649 + 250 * options.subscriber.participant.domain);
  return 1;
}

bool write_json(const std::string& path, const nlohmann::json& json) {
  std::ofstream file(path);
  file << json.dump(2) << '\n';
  if (file.flush()) return true;
  std::fprintf(stderr, "nilio watch: cannot write %s: %s\n", path.c_str(), std::strerror(errno));
  return false;
}

}  // namespace

int run(const Options& options) {
  TumFile tum;
  if (!options.tum_path.empty() && !tum.open(options.tum_path)) {
    std::fprintf(stderr, "nilio watch: cannot write %s: %s\n", options.tum_path.c_str(),
                 std::strerror(errno));
    return 1;
  }
  const int signals = take_signals();
  dds::set_fastdds_log_handler([](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); });
  auto subscriber = dds::OdometrySubscriber::create(options.subscriber);
  if (!subscriber) {
    std::fprintf(stderr, "nilio watch: %s\n", subscriber.error().message.c_str());
    return 1;
  }
  WatchStatistics statistics;
  receive(options, signals, **subscriber, tum, statistics);
  close(signals);
  const dds::SubscriberCounts counts = (*subscriber)->counts();
  if (statistics.poses() == 0) return explain_silence(options, counts.publishers);
  statistics.print_summary(counts);
  const auto report = (*subscriber)->latency_report();
  const auto imu_statuses = (*subscriber)->imu_statuses();
  if (report) print_report(*report);
  if (!imu_statuses.empty()) print_imu_status(imu_statuses.back());
  if (const auto diagnostics = (*subscriber)->diagnostics()) print_diagnostics(*diagnostics);
  if (!tum.close()) {
    std::fprintf(stderr, "nilio watch: not all poses could be written to %s (disk full?)\n",
                 options.tum_path.c_str());
    return 1;
  }
  if (options.json_path.empty()) return 0;
  nlohmann::json json = statistics.json(counts);
  if (report) json["publisher"] = report_json(*report);
  if (!imu_statuses.empty()) json["imu_rate"] = imu_status_json(imu_statuses.back());
  return write_json(options.json_path, json) ? 0 : 1;
}

}  // namespace nilio::tools::watch
