#include "tools/view/metrics.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/imu_health.hpp"
#include "nilio/core/tracking.hpp"
#include "nilio/core/units.hpp"

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <unistd.h>
#include <utility>
#include <vector>

namespace nilio::tools::view {

namespace {

using Labels = std::vector<std::pair<std::string, std::string>>;

constexpr std::array kStates{core::TrackingState::kInitialising, core::TrackingState::kTracking,
                             core::TrackingState::kDegraded, core::TrackingState::kLost};
constexpr std::array kSources{core::ClockSource::kHost,     core::ClockSource::kFreeRunning,
                              core::ClockSource::kNmeaOnly, core::ClockSource::kPpsLocked,
                              core::ClockSource::kPtp,      core::ClockSource::kHostAgreement};
/// As in the latency report; a stage has its series from the start.
constexpr std::array<std::string_view, 13> kStages{"receive_to_pop",
                                                   "assemble",
                                                   "queue",
                                                   "filter",
                                                   "coarse",
                                                   "fine",
                                                   "deliver",
                                                   "pick_up",
                                                   "write",
                                                   "end_to_end",
                                                   "received_to_written",
                                                   "imu_pick_up",
                                                   "imu_write"};

/// Use of the computer by a process, of /proc. Of several with the same name, their sum and the latest start.
struct ProcessUse {
  std::string name;
  double cpu_s = 0.0;
  double resident_bytes = 0.0;
  double start_unix_s = 0.0;
};

namespace fs = std::filesystem;

double boot_unix_s() {
  std::ifstream file("/proc/stat");
  std::string key;
  double value = 0.0;
  while (file >> key) {
    if (key == "btime" && file >> value) return value;
    std::getline(file, key);
  }
  return 0.0;
}

/// Adds the process of a /proc/PID folder if it has this name, or if the name is empty.
bool add_process(const fs::path& folder, const std::string& name, ProcessUse& use) {
  std::ifstream file(folder / "stat");
  std::string line;
  if (!std::getline(file, line)) return false;
  // pid (name) state ...: the name may hold anything.
  const std::size_t open = line.find('(');
  const std::size_t close = line.rfind(')');
  if (open == std::string::npos || close == std::string::npos) return false;
  if (!name.empty() && line.substr(open + 1, close - open - 1) != name) return false;
  std::istringstream fields(line.substr(close + 2));
  std::string skipped;
  double user = 0.0;
  double system = 0.0;
  double start = 0.0;
  double pages = 0.0;
  // Fields 3 to 13 of proc(5), then utime and stime, 16 to 21, starttime, vsize, rss.
  for (int i = 3; i <= 13; ++i) fields >> skipped;
  fields >> user >> system;
  for (int i = 16; i <= 21; ++i) fields >> skipped;
  fields >> start >> skipped >> pages;
  if (!fields) return false;
  const auto ticks = static_cast<double>(::sysconf(_SC_CLK_TCK));
  use.cpu_s += (user + system) / ticks;
  use.resident_bytes += pages * static_cast<double>(::sysconf(_SC_PAGESIZE));
  use.start_unix_s = std::max(use.start_unix_s, boot_unix_s() + start / ticks);
  return true;
}

/// Of this program, as "nilio-view".
ProcessUse own_use() {
  ProcessUse use{.name = "nilio-view"};
  add_process("/proc/self", "", use);
  return use;
}

/// Of the processes of this computer with this name; unset without one.
std::optional<ProcessUse> use_of(const std::string& name) {
  ProcessUse use{.name = name};
  bool found = false;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const std::string file = entry.path().filename().string();
    if (!file.empty() && std::ranges::all_of(file, [](char c) { return c >= '0' && c <= '9'; }))
      found = add_process(entry.path(), name, use) || found;
  }
  if (!found) return std::nullopt;
  return use;
}

std::string number_text(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "+Inf" : "-Inf";
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value);
  return {text.data(), end.ptr};
}

/// Bound of a bucket as Prometheus itself writes it.
std::string bound_text(double seconds) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", seconds);
  return text.data();
}

std::string escaped(const std::string& value) {
  std::string text;
  for (const char letter : value) {
    if (letter == '\\' || letter == '"') text += '\\';
    text += letter == '\n' ? std::string("\\n") : std::string(1, letter);
  }
  return text;
}

/// Families of metrics in either text form.
class Exposition {
 public:
  explicit Exposition(MetricsFormat format) : open_(format == MetricsFormat::kOpenMetrics) {}

  /// `name` without "_total"; of an info without "_info".
  void begin(std::string name, const char* type, const char* help, const char* unit = "") {
    name_ = std::move(name);
    type_ = type;
    const bool is_counter = type_ == "counter";
    const std::string family = open_ ? name_
                                     : name_ + (is_counter        ? "_total"
                                                : type_ == "info" ? "_info"
                                                                  : "");
    const char* const shown =
        open_ || type_ == "gauge" || is_counter || type_ == "histogram" ? type : "gauge";
    text_ += "# HELP " + family + " " + help + "\n# TYPE " + family + " " + shown + "\n";
    if (open_ && *unit != '\0') text_ += "# UNIT " + family + " " + unit + "\n";
  }
  void add(double value, const Labels& labels = {}) {
    sample(name_ + (type_ == "counter" ? "_total" : type_ == "info" ? "_info" : ""), value, labels);
  }
  void sample(const std::string& name, double value, const Labels& labels) {
    text_ += name;
    for (std::size_t i = 0; i < labels.size(); ++i)
      text_ += (i == 0 ? "{" : ",") + labels[i].first + "=\"" + escaped(labels[i].second) + "\"";
    text_ += (labels.empty() ? " " : "} ") + number_text(value) + '\n';
  }
  void counter(const std::string& name, const char* help, double value) {
    begin(name, "counter", help);
    add(value);
  }
  void gauge(const std::string& name, const char* help, double value, const char* unit = "") {
    begin(name, "gauge", help, unit);
    add(value);
  }
  std::string take() {
    if (open_) text_ += "# EOF\n";
    return std::move(text_);
  }

 private:
  bool open_;
  std::string text_;
  std::string name_;
  std::string_view type_;
};

double count_of(const std::map<std::string, std::uint64_t>& counts, const std::string& name) {
  const auto found = counts.find(name);
  return found == counts.end() ? 0.0 : static_cast<double>(found->second);
}

/// Folds the buckets of the report, eight per octave, into the fixed ones: a bucket counts where its upper
/// end is. The sum is that of the middles of the buckets.
void add_stage(Exposition& out, std::string_view name, const dds::StageLatency* stage) {
  const Labels labels{{"stage", std::string(name)}};
  std::array<double, kStageBoundsUs.size() + 1> counts{};
  double sum_us = 0.0;
  if (stage != nullptr) {
    for (const dds::LatencyBucket& bucket : stage->buckets) {
      if (!(bucket.from_us >= 0.0) || !(bucket.to_us >= bucket.from_us)) continue;
      // Buckets end at binary fractions, bounds at round numbers.
      const auto bound = std::lower_bound(kStageBoundsUs.begin(), kStageBoundsUs.end(), bucket.to_us);
      counts[static_cast<std::size_t>(bound - kStageBoundsUs.begin())] += static_cast<double>(bucket.count);
      sum_us += 0.5 * (bucket.from_us + bucket.to_us) * static_cast<double>(bucket.count);
    }
  }
  double below = 0.0;
  for (std::size_t i = 0; i < counts.size(); ++i) {
    below += counts[i];
    Labels of_bucket = labels;
    of_bucket.emplace_back("le", i < kStageBoundsUs.size() ? bound_text(kStageBoundsUs[i] * 1e-6) : "+Inf");
    out.sample("nilio_stage_seconds_bucket", below, of_bucket);
  }
  out.sample("nilio_stage_seconds_sum", sum_us * 1e-6, labels);
  out.sample("nilio_stage_seconds_count", below, labels);
}

void add_stages(Exposition& out, const LiveState& state) {
  out.begin("nilio_stage_seconds", "histogram",
            "Duration of a stage of a scan or IMU sample since nilio-publisher started.", "seconds");
  for (const std::string_view name : kStages) {
    const dds::StageLatency* found = nullptr;
    if (state.latency()) {
      for (const dds::StageLatency& stage : state.latency()->stages) {
        if (stage.name == name) found = &stage;
      }
    }
    add_stage(out, name, found);
  }
}

/// Exact percentiles of the last ten and sixty seconds: those of a histogram are as coarse as its buckets.
void add_percentiles(Exposition& out, const LiveState& state, std::int64_t now_ns) {
  out.begin("nilio_stage_recent_seconds", "gauge", "Percentile of a stage over the last seconds.", "seconds");
  for (const char* name : {"received_to_written", "end_to_end", "queue", "filter", "coarse", "fine"}) {
    for (const int seconds : {10, 60}) {
      const Percentiles p = state.window().percentiles(StageWindow::index_of(name), now_ns,
                                                       std::int64_t{seconds} * kNanosecondsPerSecond);
      for (const auto& [quantile, value] :
           {std::pair{"0.5", p.median}, std::pair{"0.99", p.p99}, std::pair{"1", p.maximum}})
        out.add(value * 1e-3,
                {{"stage", name}, {"window", std::to_string(seconds) + "s"}, {"percentile", quantile}});
    }
  }
}

void add_counters(Exposition& out, const LiveState& state) {
  const ScanCounts& counts = state.counts();
  const auto& latency = state.latency();
  const auto from_report = [&](std::uint64_t dds::LatencyReport::*member) {
    return latency ? static_cast<double>((*latency).*member) : 0.0;
  };
  out.counter("nilio_poses", "Poses written to DDS since nilio-publisher started.",
              from_report(&dds::LatencyReport::poses_published));
  out.counter("nilio_imu_poses", "IMU-rate poses written to DDS since nilio-publisher started.",
              from_report(&dds::LatencyReport::imu_poses_published));
  out.counter("nilio_poses_received", "Poses that nilio view received.",
              static_cast<double>(state.subscriber().received));
  out.begin("nilio_poses_lost", "counter", "Poses that did not arrive, by the place of their loss.");
  out.add(static_cast<double>(state.subscriber().lost), {{"where", "network"}});
  out.add(static_cast<double>(state.subscriber().queue_dropped), {{"where", "view"}});
  out.add(from_report(&dds::LatencyReport::ring_dropped), {{"where", "ring"}});
  out.add(from_report(&dds::LatencyReport::failed_writes), {{"where", "write"}});
  out.counter("nilio_scans_dropped", "Scans skipped for newer ones since niliod started.",
              static_cast<double>(counts.superseded));
  out.counter("nilio_lidar_packets_lost", "LiDAR packets lost, of the scans that nilio view knows.",
              static_cast<double>(counts.lost_packets));
  out.counter("nilio_deadline_misses", "Poses after their deadline, initialisation excluded.",
              static_cast<double>(counts.late));
  out.counter("nilio_guarded_poses", "Predictions published because the registration was late.",
              static_cast<double>(counts.guarded));
  out.counter("nilio_map_resets", "Map resets and relocalisations, from the diagnostics.",
              static_cast<double>(state.map_resets()));
  out.begin("nilio_degradation", "counter", "Scans by degradation level.");
  for (std::size_t i = 0; i < core::kDegradationLevels; ++i) {
    const char* const name = core::name_of(static_cast<core::DegradationLevel>(i));
    out.add(count_of(counts.degradation_levels, name), {{"level", name}});
  }
  out.begin("nilio_scans", "counter", "Scans by tracking state.");
  for (const auto tracking : kStates)
    out.add(count_of(counts.states, core::name_of(tracking)), {{"state", core::name_of(tracking)}});
}

/// Value of a row of nilio's diagnostics.
std::string diagnostic(const LiveState& state, std::string_view group, std::string_view key) {
  if (!state.diagnostics()) return {};
  for (const dds::DiagnosticStatus& status : state.diagnostics()->statuses) {
    if (status.name != "nilio: " + std::string(group)) continue;
    for (const dds::KeyValue& value : status.values) {
      if (value.key == key) return value.value;
    }
  }
  return {};
}

void add_live_gauges(Exposition& out, const LiveState& state) {
  out.gauge("nilio_pose_age_seconds", "Time since the newest pose arrived.", state.pose_age_s(), "seconds");
  out.gauge("nilio_pose_rate_hertz", "Poses per second over the last five seconds.", state.rate_hz(),
            "hertz");
  out.gauge("nilio_real_time_ratio", "Processing time of a scan over its duration, mean of the last minute.",
            state.real_time_ratio());
  if (state.budget_ms() > 0.0)
    out.gauge("nilio_budget_seconds", "Time from the last packet to the deadline.", state.budget_ms() * 1e-3,
              "seconds");
  if (!state.report()) return;
  out.begin("nilio_state", "stateset", "Tracking state of the newest scan.");
  for (const auto tracking : kStates)
    out.add(state.report()->state == core::name_of(tracking) ? 1.0 : 0.0,
            {{"nilio_state", core::name_of(tracking)}});
  out.gauge("nilio_map_voxels", "Voxels of the local map.", state.report()->map_voxels);
  out.begin("nilio_axis_observed", "gauge", "1: the newest scan observes this axis of base_link.");
  constexpr std::array kAxes{"x", "y", "z", "roll", "pitch", "yaw"};
  for (std::size_t i = 0; i < kAxes.size(); ++i)
    out.add((state.report()->degenerate_axes >> i & 1U) != 0U ? 0.0 : 1.0, {{"axis", kAxes[i]}});
  const std::string source = diagnostic(state, "LiDAR", "time source");
  if (!source.empty()) {
    out.begin("nilio_time_source", "stateset", "Source of the time of a sensor.");
    for (const auto one : kSources)
      out.add(source == core::name_of(one) ? 1.0 : 0.0,
              {{"sensor", "lidar"}, {"nilio_time_source", core::name_of(one)}});
  }
  const std::string offset = diagnostic(state, "IMU", "time_offset");
  double offset_ms = 0.0;
  if (std::from_chars(offset.data(), offset.data() + offset.size(), offset_ms).ec == std::errc()) {
    out.begin("nilio_time_offset_seconds", "gauge",
              "Stamps of a sensor less those of the LiDAR for the same instant.", "seconds");
    out.add(offset_ms * 1e-3, {{"sensor", "imu"}});
  }
  if (diagnostic(state, "IMU", "use").empty()) return;
  out.gauge("nilio_imu_used", "1: the IMU is used.", diagnostic(state, "IMU", "use") == "used" ? 1.0 : 0.0);
  out.begin("nilio_imu_check", "gauge", "1: the check is passed, or cannot be made yet.");
  for (std::size_t i = 0; i < core::kImuChecks; ++i) {
    const char* const name = core::name_of(static_cast<core::ImuCheck>(i));
    const std::string value = diagnostic(state, "IMU", name);
    out.add(value.ends_with("warn") || value.ends_with("bad") ? 0.0 : 1.0, {{"check", name}});
  }
}

void add_processes(Exposition& out, bool is_daemon_here) {
  std::vector<ProcessUse> processes{own_use()};
  if (is_daemon_here) {
    for (const char* name : {"niliod", "nilio-publisher"}) {
      if (const auto use = use_of(name)) processes.push_back(*use);
    }
  }
  out.begin("process_cpu_seconds", "counter", "CPU time of the processes of this computer by name.",
            "seconds");
  for (const ProcessUse& process : processes) out.add(process.cpu_s, {{"process", process.name}});
  out.begin("process_resident_memory_bytes", "gauge", "Resident memory of these processes.", "bytes");
  for (const ProcessUse& process : processes) out.add(process.resident_bytes, {{"process", process.name}});
  out.begin("nilio_start_time_seconds", "gauge", "Start of these processes since the Unix epoch.", "seconds");
  for (const ProcessUse& process : processes) out.add(process.start_unix_s, {{"process", process.name}});
}

}  // namespace

MetricsFormat metrics_format(std::string_view accept) {
  return accept.find("application/openmetrics-text") == std::string_view::npos ? MetricsFormat::kPrometheus
                                                                               : MetricsFormat::kOpenMetrics;
}

const char* content_type_of(MetricsFormat format) {
  return format == MetricsFormat::kOpenMetrics ? "application/openmetrics-text; version=1.0.0; charset=utf-8"
                                               : "text/plain; version=0.0.4; charset=utf-8";
}

std::string metrics_text(const LiveState& state, const ServerCounts& server, std::size_t map_points,
                         MetricsFormat format) {
  Exposition out(format);
  out.begin("nilio_build", "info", "Version of nilio view.");
  out.add(1.0, {{"version", NILIO_VERSION}});
  out.gauge("nilio_daemon_alive", "1: poses arrive.", state.is_alive() ? 1.0 : 0.0);
  add_counters(out, state);
  add_stages(out, state);
  if (state.is_alive()) {
    add_live_gauges(out, state);
    add_percentiles(out, state, state.now_ns());
  }
  out.gauge("nilio_view_map_points", "Points of the map that nilio view keeps.",
            static_cast<double>(map_points));
  out.gauge("nilio_view_clients", "Pages that are connected.", static_cast<double>(server.clients));
  out.counter("nilio_view_requests", "HTTP requests.", static_cast<double>(server.requests));
  out.counter("nilio_view_refused", "Requests and connections refused.", static_cast<double>(server.refused));
  out.counter("nilio_view_slow_clients", "Connections closed because they were too slow.",
              static_cast<double>(server.slow_clients));
  out.counter("nilio_view_sent_bytes", "Bytes sent to clients.", static_cast<double>(server.bytes_sent));
  const bool is_here = state.report() && state.is_same_host();
  add_processes(out, is_here);
  return out.take();
}

}  // namespace nilio::tools::view
