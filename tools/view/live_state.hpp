#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/messages/messages.hpp"
#include "tools/view/live_path.hpp"
#include "tools/view/stage_window.hpp"
#include "tools/watch/packet_to_pose.hpp"

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace nilio::tools::view {

/// Sums over the scan reports since this program started.
struct ScanCounts {
  std::uint64_t reports = 0;
  std::uint64_t lost_packets = 0;
  std::uint64_t missing_firings = 0;
  std::uint64_t superseded = 0;  ///< as niliod counts them, since it started
  std::uint64_t late = 0;        ///< after their deadline
  std::uint64_t guarded = 0;
  std::map<std::string, std::uint64_t> states;
  std::map<std::string, std::uint64_t> degradation_levels;
};

/// Entry of the event log of the page.
struct Event {
  std::uint64_t id = 0;
  double unix_s = 0.0;
  std::string level;  ///< info, warning, error
  std::string text;
};

/// A live nilio as a subscriber knows it: newest pose, counts, latencies, diagnostics and events. Text
/// and numbers come from the network and may have any value. One thread.
class LiveState {
 public:
  /// `place`: the domain and topic prefix, for messages.
  explicit LiveState(std::string place);

  void add(const dds::ReceivedOdometry& sample);
  void add(const dds::ScanReport& report);
  /// The part before the first pose received here becomes the beginning of the path.
  void add(const dds::Path& path);
  void set(const dds::LatencyReport& report) { latency_ = report; }
  void set(const dds::DiagnosticArray& diagnostics);
  void set(const dds::SubscriberCounts& counts);
  /// Call about ten times a second. `now_ns`: CLOCK_MONOTONIC.
  void tick(std::int64_t now_ns);

  /// A pose has arrived within three periods, or half a second.
  [[nodiscard]] bool is_alive() const { return alive_; }
  /// CLOCK_MONOTONIC of the last tick().
  [[nodiscard]] std::int64_t now_ns() const { return now_ns_; }
  /// The newest report is of this computer.
  [[nodiscard]] bool is_same_host() const { return report_ && report_->host_id == host_id_; }
  /// Why there is nothing to show; empty while alive.
  [[nodiscard]] std::string why_silent() const;
  [[nodiscard]] double pose_age_s() const;
  /// Over the last five seconds.
  [[nodiscard]] double rate_hz() const;
  /// From the last packet to the deadline; 0 = none is set, or unknown.
  [[nodiscard]] double budget_ms() const { return budget_ms_; }
  /// Share of the scan's duration that its processing took, mean of the last minute.
  [[nodiscard]] double real_time_ratio() const;
  [[nodiscard]] const std::optional<dds::ReceivedOdometry>& pose() const { return pose_; }
  [[nodiscard]] const std::optional<dds::ScanReport>& report() const { return report_; }
  [[nodiscard]] const std::optional<dds::LatencyReport>& latency() const { return latency_; }
  [[nodiscard]] const std::optional<dds::DiagnosticArray>& diagnostics() const { return diagnostics_; }
  [[nodiscard]] const dds::SubscriberCounts& subscriber() const { return subscriber_; }
  [[nodiscard]] const ScanCounts& counts() const { return counts_; }
  [[nodiscard]] const StageWindow& window() const { return window_; }
  [[nodiscard]] const watch::PacketToPose& packet_to_here() const { return packet_to_here_; }
  [[nodiscard]] const LivePath& path() const { return path_; }
  [[nodiscard]] double path_length_m() const { return path_length_m_; }
  [[nodiscard]] std::uint64_t map_resets() const { return map_resets_; }
  /// Counts up when another drive begins: map and path before it are void.
  [[nodiscard]] std::uint64_t drive() const { return drive_; }
  /// Seconds of a stamp since the first pose of the drive.
  [[nodiscard]] float drive_time_s(core::Time stamp) const;
  /// Reports the map's reset, which a pose alone does not show.
  void note(const std::string& level, const std::string& text);

  /// Ten times a second: pose, state and the scans since the last call.
  [[nodiscard]] nlohmann::json state_json() const;
  /// Once a second: percentiles, diagnostics, counters.
  [[nodiscard]] nlohmann::json summary_json() const;
  /// Rows of the scans since number `first`; that of the next one comes back.
  [[nodiscard]] nlohmann::json scan_rows(std::uint64_t& first) const;
  [[nodiscard]] nlohmann::json events_json(std::uint64_t first) const;
  [[nodiscard]] std::uint64_t last_event() const { return events_.empty() ? 0 : events_.back().id; }
  static nlohmann::json column_names();

 private:
  static constexpr std::size_t kColumns = 16;
  static constexpr std::size_t kRows = 1200;
  static constexpr std::size_t kEvents = 200;

  void note_changes(const dds::ScanReport& report);
  void begin_drive(const std::string& why);

  std::string place_;
  std::string host_id_;
  std::int64_t now_ns_ = 0;
  bool alive_ = false;
  bool was_alive_ = false;
  std::optional<dds::ReceivedOdometry> pose_;
  std::optional<dds::ScanReport> report_;
  std::optional<dds::LatencyReport> latency_;
  std::optional<dds::DiagnosticArray> diagnostics_;
  std::map<std::string, int> diagnostic_levels_;
  dds::SubscriberCounts subscriber_;
  ScanCounts counts_;
  StageWindow window_;
  watch::PacketToPose packet_to_here_;
  std::map<std::int64_t, std::int64_t> received_ns_;  ///< receipt of recent poses by stamp
  LivePath path_;
  bool has_earlier_path_ = false;
  double path_length_m_ = 0.0;
  double budget_ms_ = 0.0;
  std::uint64_t map_resets_ = 0;
  std::uint64_t drive_ = 1;
  std::optional<core::Time> first_stamp_;
  std::deque<std::int64_t> arrivals_;
  std::deque<std::array<double, kColumns>> rows_;
  std::uint64_t next_row_ = 0;
  std::deque<Event> events_;
  std::uint64_t lost_at_last_event_ = 0;
  std::int64_t next_loss_event_ns_ = 0;
};

/// Text from the network, safe to show: valid UTF-8 without control characters, of bounded length.
std::string clean_text(const std::string& text, std::size_t longest = 400);

}  // namespace nilio::tools::view
