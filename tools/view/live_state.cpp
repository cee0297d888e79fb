#include "tools/view/live_state.hpp"

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/tracking.hpp"

#include "ipc/dds/reports.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include <nlohmann/json.hpp>

namespace nilio::tools::view {

namespace {

using nlohmann::json;

constexpr std::int64_t kRateWindowNs = 5'000'000'000;
constexpr std::int64_t kSilentNs = 500'000'000;
constexpr std::int64_t kLossEventNs = 1'000'000'000;
constexpr std::uint8_t kEarlierState = 4;  ///< of a vertex from before this program: its state is not known
constexpr std::size_t kRecentPoses = 64;
constexpr std::size_t kMaxNames = 16;  ///< of states and levels: names come from the network

bool is_finite(const dds::Odometry& message) {
  const auto finite = [](double number) { return std::isfinite(number) && std::abs(number) < 1e9; };
  return std::ranges::all_of(message.position, finite) &&
         std::ranges::all_of(message.orientation_xyzw, finite) &&
         std::ranges::all_of(message.linear_velocity, finite);
}

double norm(const std::array<double, 3>& v) { return std::hypot(v[0], v[1], v[2]); }

std::uint8_t code_of_state(const std::string& name) {
  for (const auto state : {core::TrackingState::kInitialising, core::TrackingState::kTracking,
                           core::TrackingState::kDegraded, core::TrackingState::kLost}) {
    if (name == core::name_of(state)) return static_cast<std::uint8_t>(state);
  }
  return 0;
}

std::uint8_t code_of_level(const std::string& name) {
  for (std::uint8_t i = 0; i < core::kDegradationLevels; ++i) {
    if (name == core::name_of(static_cast<core::DegradationLevel>(i))) return i;
  }
  return 0;
}

double unix_seconds() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

void count_name(std::map<std::string, std::uint64_t>& counts, const std::string& name) {
  if (counts.size() < kMaxNames || counts.contains(name)) ++counts[clean_text(name, 40)];
}

json stage_rows(const dds::LatencyReport& report) {
  json rows = json::array();
  for (const dds::StageLatency& stage : report.stages) {
    if (rows.size() >= 64) break;
    rows.push_back({{"name", clean_text(stage.name, 40)},
                    {"count", stage.count},
                    {"p50_us", stage.p50_us},
                    {"p90_us", stage.p90_us},
                    {"p99_us", stage.p99_us},
                    {"p99_9_us", stage.p99_9_us},
                    {"max_us", stage.max_us}});
  }
  return rows;
}

json diagnostic_groups(const dds::DiagnosticArray& diagnostics) {
  json groups = json::array();
  for (const dds::DiagnosticStatus& status : diagnostics.statuses) {
    if (groups.size() >= 32) break;
    json values = json::array();
    for (const dds::KeyValue& value : status.values) {
      if (values.size() >= 64) break;
      values.push_back({clean_text(value.key, 80), clean_text(value.value, 200)});
    }
    groups.push_back({{"name", clean_text(status.name, 80)},
                      {"level", static_cast<int>(status.level)},
                      {"message", clean_text(status.message)},
                      {"values", values}});
  }
  return groups;
}

}  // namespace

std::string clean_text(const std::string& text, std::size_t longest) {
  std::string clean;
  for (const char letter : text.substr(0, longest))
    clean += static_cast<unsigned char>(letter) < 0x20 || letter == 0x7F ? ' ' : letter;
  // Damaged UTF-8 becomes replacement characters.
  return json::parse(json(clean).dump(-1, ' ', false, json::error_handler_t::replace)).get<std::string>();
}

LiveState::LiveState(std::string place)
    : place_(std::move(place)), host_id_(dds::read_host_id()), packet_to_here_(host_id_) {}

void LiveState::note(const std::string& level, const std::string& text) {
  if (events_.size() >= kEvents) events_.pop_front();
  const std::uint64_t id = last_event() + 1;
  events_.push_back({.id = id, .unix_s = unix_seconds(), .level = level, .text = clean_text(text)});
}

void LiveState::begin_drive(const std::string& why) {
  path_.clear();
  has_earlier_path_ = false;
  path_length_m_ = 0.0;
  first_stamp_.reset();
  ++drive_;
  note("warning", why);
}

float LiveState::drive_time_s(core::Time stamp) const {
  return first_stamp_ ? static_cast<float>((stamp - *first_stamp_).seconds()) : 0.0F;
}

void LiveState::add(const dds::ReceivedOdometry& sample) {
  packet_to_here_.add_pose(sample.message.stamp, sample.received_ns);
  arrivals_.push_back(sample.received_ns);
  if (arrivals_.size() > 2 * kRows) arrivals_.pop_front();
  if (!is_finite(sample.message)) return;
  if (!first_stamp_) first_stamp_ = sample.message.stamp;
  if (pose_ && pose_->message.stamp < sample.message.stamp) {
    const auto& a = pose_->message.position;
    const auto& b = sample.message.position;
    if (!path_.vertices().empty()) path_length_m_ += norm({b[0] - a[0], b[1] - a[1], b[2] - a[2]});
  }
  pose_ = sample;
  received_ns_[sample.message.stamp.ns] = sample.received_ns;
  while (received_ns_.size() > kRecentPoses) received_ns_.erase(received_ns_.begin());
  const auto& p = sample.message.position;
  // State and level are those of the newest report: the pose's own follows within a millisecond.
  path_.add({.time_s = static_cast<double>(drive_time_s(sample.message.stamp)),
             .position = {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])},
             .speed_m_s = static_cast<float>(norm(sample.message.linear_velocity)),
             .state = report_ ? code_of_state(report_->state) : std::uint8_t{0},
             .degradation_level = report_ ? code_of_level(report_->degradation_level) : std::uint8_t{0},
             .degenerate_axes = report_ ? report_->degenerate_axes : std::uint8_t{0},
             .sequence = report_ ? static_cast<std::uint32_t>(report_->sequence) : 0U});
}

void LiveState::add(const dds::Path& path) {
  // Poses from here on carry more than the path message does.
  if (!first_stamp_ || path_.vertices().empty() || has_earlier_path_ ||
      path.poses.size() > LivePath::kMaxVertices)
    return;
  std::vector<PathVertex> earlier;
  for (const dds::PoseStamped& pose : path.poses) {
    const auto& p = pose.position;
    const bool is_finite =
        std::ranges::all_of(p, [](double v) { return std::isfinite(v) && std::abs(v) < 1e9; });
    if (!is_finite || pose.stamp >= *first_stamp_) continue;
    earlier.push_back(
        {.time_s = (pose.stamp - *first_stamp_).seconds(),
         .position = {static_cast<float>(p[0]), static_cast<float>(p[1]), static_cast<float>(p[2])},
         .state = kEarlierState});
  }
  has_earlier_path_ = true;
  path_.prepend(std::move(earlier));
}

void LiveState::note_changes(const dds::ScanReport& report) {
  if (!report_) {
    note("info", "first scan report: scan " + std::to_string(report.sequence) + ", " + report.state);
    return;
  }
  // A restarted nilio-publisher continues the numbers, a restarted niliod does not.
  if (report.sequence < report_->sequence) {
    begin_drive("niliod was restarted: path and map begin anew");
    counts_.superseded = 0;
  }
  if (report.state != report_->state) {
    const std::string level = report.state == "lost"       ? "error"
                              : report.state == "tracking" ? "info"
                                                           : "warning";
    note(level, "scan " + std::to_string(report.sequence) + ": " + report_->state + " → " + report.state +
                    " (" + report.stop_reason + ")");
  }
  if (report.degradation_level != report_->degradation_level)
    note(report.degradation_level == "full" ? "info" : "warning",
         "scan " + std::to_string(report.sequence) + ": degradation level " + report_->degradation_level +
             " → " + report.degradation_level);
  if (report.degenerate_axes != report_->degenerate_axes) {
    std::string axes;
    constexpr std::array kAxes{"x", "y", "z", "roll", "pitch", "yaw"};
    for (std::size_t i = 0; i < kAxes.size(); ++i) {
      if ((report.degenerate_axes >> i & 1U) != 0U) axes += std::string(axes.empty() ? "" : ", ") + kAxes[i];
    }
    note(axes.empty() ? "info" : "warning",
         "scan " + std::to_string(report.sequence) + ": " +
             (axes.empty() ? "all directions observed" : "not observed: " + axes));
  }
  if (report.superseded > report_->superseded)
    note("warning", "scan " + std::to_string(report.sequence) + ": " +
                        std::to_string(report.superseded - report_->superseded) +
                        " scans skipped for newer ones");
}

void LiveState::add(const dds::ScanReport& report) {
  packet_to_here_.add_report(report);
  note_changes(report);
  ++counts_.reports;
  counts_.lost_packets += report.lost_packets;
  counts_.missing_firings += report.missing_firings;
  counts_.superseded = report.superseded;
  if (report.guarded) ++counts_.guarded;
  const bool is_initialising = report.state == "initialising";
  if (report.overshoot_ns > 0 && !is_initialising) ++counts_.late;
  count_name(counts_.states, report.state);
  count_name(counts_.degradation_levels, report.degradation_level);

  const StageWindow::Durations durations = StageWindow::durations_of(report);
  const double end_to_end = durations[StageWindow::index_of("end_to_end")];
  const double overshoot_ms = static_cast<double>(report.overshoot_ns) * 1e-6;
  if (report.overshoot_ns != 0 && end_to_end >= 0.0 && !is_initialising)
    budget_ms_ = std::round(10.0 * (end_to_end - overshoot_ms)) / 10.0;
  double processing_ms = 0.0;
  for (const char* name : {"filter", "coarse", "fine", "deliver"})
    processing_ms += std::max(durations[StageWindow::index_of(name)], 0.0);
  const double scan_ms = (report.stamp - report.scan_start).seconds() * 1e3;
  window_.add(now_ns_, durations, scan_ms > 0.0 ? processing_ms / scan_ms : 0.0);

  std::int64_t received_here = 0;
  if (const auto found = received_ns_.find(report.stamp.ns); found != received_ns_.end())
    received_here = found->second;
  double to_here_ms = -1.0;
  for (const dds::StageStamp& stage : report.stages) {
    if (stage.name == "received" && stage.monotonic_ns > 0 && received_here > stage.monotonic_ns &&
        report.host_id == host_id_)
      to_here_ms = static_cast<double>(received_here - stage.monotonic_ns) * 1e-6;
  }
  const auto at = [&](const char* name) { return durations[StageWindow::index_of(name)]; };
  rows_.push_back({static_cast<double>(report.sequence), static_cast<double>(drive_time_s(report.stamp)),
                   static_cast<double>(code_of_state(report.state)),
                   static_cast<double>(code_of_level(report.degradation_level)), end_to_end,
                   at("received_to_written"), to_here_ms, at("queue"), at("filter"), at("coarse"), at("fine"),
                   static_cast<double>(report.points_used), static_cast<double>(report.lost_packets),
                   overshoot_ms, pose_ ? norm(pose_->message.linear_velocity) : 0.0,
                   static_cast<double>(report.points)});
  ++next_row_;
  if (rows_.size() > kRows) rows_.pop_front();
  report_ = report;
}

json LiveState::column_names() {
  return {"scan",
          "time_s",
          "state",
          "level",
          "end_to_end_ms",
          "received_to_written_ms",
          "packet_to_here_ms",
          "queue_ms",
          "filter_ms",
          "coarse_ms",
          "fine_ms",
          "points_used",
          "lost_packets",
          "overshoot_ms",
          "speed_m_s",
          "points"};
}

void LiveState::set(const dds::DiagnosticArray& diagnostics) {
  if (diagnostics_ && diagnostics.stamp == diagnostics_->stamp) return;
  const auto value_of = [](const dds::DiagnosticStatus& status, const std::string& key) -> std::string {
    for (const dds::KeyValue& value : status.values) {
      if (value.key == key) return value.value;
    }
    return {};
  };
  bool is_ours = false;
  for (const dds::DiagnosticStatus& status : diagnostics.statuses) {
    if (!status.name.starts_with("nilio: ")) continue;
    is_ours = true;
    const int level = static_cast<int>(status.level);
    const auto before = diagnostic_levels_.find(status.name);
    // The state's own changes are events already.
    if (before != diagnostic_levels_.end() && before->second != level && status.name != "nilio: odometry")
      note(level == 0   ? "info"
           : level == 1 ? "warning"
                        : "error",
           status.name.substr(7) + ": " + status.message);
    if (before != diagnostic_levels_.end() || diagnostic_levels_.size() < kMaxNames)
      diagnostic_levels_[status.name] = level;
    if (const std::uint64_t resets = std::strtoull(value_of(status, "resets").c_str(), nullptr, 10);
        resets > 0) {
      map_resets_ += resets;
      note("warning", "the map was reset or the pose relocalised: the pose jumps here");
    }
  }
  // The topic is shared with other programs.
  if (is_ours) diagnostics_ = diagnostics;
}

void LiveState::set(const dds::SubscriberCounts& counts) {
  if (counts.publishers != subscriber_.publishers)
    note(counts.publishers > 0 ? "info" : "error", counts.publishers > 0
                                                       ? "connected to nilio-publisher (" + place_ + ")"
                                                       : "nilio-publisher has gone");
  if (counts.writers_seen > subscriber_.writers_seen && subscriber_.writers_seen > 0)
    note("warning", "another nilio-publisher writes the poses: it was restarted, or there are two");
  if (counts.lost > subscriber_.lost)
    note("warning",
         std::to_string(counts.lost - subscriber_.lost) + " poses lost between publisher and view");
  subscriber_ = counts;
}

void LiveState::tick(std::int64_t now_ns) {
  now_ns_ = now_ns;
  window_.drop_old(now_ns);
  while (!arrivals_.empty() && now_ns - arrivals_.front() > kRateWindowNs) arrivals_.pop_front();
  const double rate = rate_hz();
  const auto patience =
      std::max<std::int64_t>(kSilentNs, rate > 0.0 ? static_cast<std::int64_t>(3e9 / rate) : 0);
  alive_ = !arrivals_.empty() && now_ns - arrivals_.back() < patience;
  if (was_alive_ && !alive_) note("error", "no poses: " + why_silent());
  was_alive_ = alive_;
  if (counts_.lost_packets > lost_at_last_event_ && now_ns >= next_loss_event_ns_) {
    note("warning", std::to_string(counts_.lost_packets - lost_at_last_event_) + " LiDAR packets lost");
    lost_at_last_event_ = counts_.lost_packets;
    next_loss_event_ns_ = now_ns + kLossEventNs;
  }
}

std::string LiveState::why_silent() const {
  if (alive_) return {};
  if (subscriber_.publishers == 0)
    return "no nilio-publisher on " + place_ +
           " - start niliod, or check --domain, --interface and the firewall; nilio view waits for it";
  return "nilio-publisher runs, but no pose comes - check niliod's log: power and cable of the LiDAR, its "
         "port";
}

double LiveState::pose_age_s() const {
  return pose_ ? static_cast<double>(now_ns_ - pose_->received_ns) * 1e-9 : -1.0;
}

double LiveState::rate_hz() const {
  if (arrivals_.size() < 2) return 0.0;
  const std::int64_t span = arrivals_.back() - arrivals_.front();
  return span > 0 ? static_cast<double>(arrivals_.size() - 1) * 1e9 / static_cast<double>(span) : 0.0;
}

double LiveState::real_time_ratio() const { return window_.mean_real_time_ratio(); }

json LiveState::state_json() const {
  json state{{"type", "state"},
             {"alive", alive_},
             {"why", why_silent()},
             {"publishers", subscriber_.publishers},
             {"received", subscriber_.received},
             {"lost", subscriber_.lost},
             {"rate_hz", rate_hz()},
             {"age_s", pose_age_s()},
             {"path_length_m", path_length_m_},
             {"drive", drive_},
             {"budget_ms", budget_ms_}};
  if (pose_) {
    const dds::Odometry& m = pose_->message;
    const auto& c = m.pose_covariance;
    state["pose"] = {{"stamp_ns", std::to_string(m.stamp.ns)},
                     {"time_s", drive_time_s(m.stamp)},
                     {"position", m.position},
                     {"orientation", m.orientation_xyzw},
                     {"linear_velocity", m.linear_velocity},
                     {"angular_velocity", m.angular_velocity},
                     {"sigma_m", std::sqrt(std::max({c[0], c[7], c[14], 0.0}))},
                     {"frame", clean_text(m.frame_id, 60)},
                     {"child_frame", clean_text(m.child_frame_id, 60)}};
  }
  if (report_) {
    const dds::ScanReport& r = *report_;
    state["scan"] = {{"sequence", r.sequence},
                     {"state", clean_text(r.state, 40)},
                     {"stop_reason", clean_text(r.stop_reason, 40)},
                     {"degradation_level", clean_text(r.degradation_level, 40)},
                     {"imu_used", r.imu_used},
                     {"predicted", r.predicted},
                     {"guarded", r.guarded},
                     {"degenerate_axes", r.degenerate_axes},
                     {"coverage_deg", r.coverage_deg},
                     {"points", r.points},
                     {"points_used", r.points_used},
                     {"correspondences", r.correspondences},
                     {"map_voxels", r.map_voxels}};
  }
  return state;
}

json LiveState::summary_json() const {
  json summary{{"type", "summary"},
               {"counts",
                {{"reports", counts_.reports},
                 {"lost_packets", counts_.lost_packets},
                 {"missing_firings", counts_.missing_firings},
                 {"superseded", counts_.superseded},
                 {"late", counts_.late},
                 {"guarded", counts_.guarded},
                 {"states", counts_.states},
                 {"levels", counts_.degradation_levels},
                 {"resets", map_resets_},
                 {"queue_dropped", subscriber_.queue_dropped},
                 {"writers_seen", subscriber_.writers_seen}}},
               {"real_time_ratio", real_time_ratio()}};
  json window = json::object();
  for (std::size_t i = 0; i < StageWindow::kStages; ++i) {
    const Percentiles p = window_.percentiles(i, now_ns_, StageWindow::kNs);
    window[std::string(StageWindow::kNames[i])] = {p.median, p.p99, p.maximum};
  }
  summary["window_ms"] = window;
  const ipc::LatencySummary here = ipc::summarize("received_to_view", packet_to_here_.histogram());
  summary["here"] = {{"count", here.count},
                     {"p50_us", here.p50_us},
                     {"p90_us", here.p90_us},
                     {"p99_us", here.p99_us},
                     {"p99_9_us", here.p99_9_us},
                     {"max_us", here.max_us},
                     {"of_other_machines", packet_to_here_.of_other_machines()}};
  if (latency_) {
    summary["stages"] = stage_rows(*latency_);
    summary["published"] = {{"poses", latency_->poses_published},
                            {"failed_writes", latency_->failed_writes},
                            {"ring_dropped", latency_->ring_dropped},
                            {"imu_poses", latency_->imu_poses_published},
                            {"imu_ring_dropped", latency_->imu_ring_dropped}};
  }
  if (diagnostics_) summary["diagnostics"] = diagnostic_groups(*diagnostics_);
  return summary;
}

json LiveState::scan_rows(std::uint64_t& first) const {
  const std::uint64_t oldest = next_row_ - rows_.size();
  json rows = json::array();
  for (std::uint64_t i = std::max(first, oldest); i < next_row_; ++i) {
    json row = json::array();
    for (const double value : rows_[static_cast<std::size_t>(i - oldest)])
      row.push_back(std::round(value * 1e3) / 1e3);
    rows.push_back(std::move(row));
  }
  first = next_row_;
  return rows;
}

json LiveState::events_json(std::uint64_t first) const {
  json events = json::array();
  for (const Event& event : events_) {
    if (event.id >= first)
      events.push_back(
          {{"id", event.id}, {"unix_s", event.unix_s}, {"level", event.level}, {"text", event.text}});
  }
  return {{"type", "events"}, {"events", events}};
}

}  // namespace nilio::tools::view
