#pragma once

#include "nilio/core/result.hpp"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace eprosima::fastdds::dds {
class DomainParticipant;
}

namespace nilio::dds {

class TopicConflicts;

/// DDS topic names ("rt/" before the ROS name).
struct TopicNames {
  std::string odometry;          ///< rt/<prefix>/odom
  std::string transform;         ///< rt/tf: a single topic in ROS
  std::string latency;           ///< rt/<prefix>/nilio/latency
  std::string scan_report;       ///< rt/<prefix>/nilio/scan_report
  std::string imu_odometry;      ///< rt/<prefix>/nilio/odometry_imu
  std::string imu_status;        ///< rt/<prefix>/nilio/odometry_imu_status
  std::string registered_scan;   ///< rt/<prefix>/registered_scan
  std::string path;              ///< rt/<prefix>/path
  std::string submaps;           ///< rt/<prefix>/submaps
  std::string submap_poses;      ///< rt/<prefix>/submap_poses
  std::string local_map;         ///< rt/<prefix>/local_map
  std::string map_corrections;   ///< rt/<prefix>/nilio/map_corrections
  std::string static_transform;  ///< rt/tf_static: a single topic in ROS
  std::string diagnostics;       ///< rt/diagnostics: a single topic in ROS
};
/// Builds the names. Leading, trailing and doubled slashes of the prefix are ignored. Fails if the name is
/// invalid in ROS.
core::Result<TopicNames> topic_names(const std::string& prefix);

struct ParticipantConfig {
  std::uint32_t domain = 0;  ///< 0..232, as ROS_DOMAIN_ID
  /// IPv4 addresses of the interfaces to use; empty: all. Loopback is always used, so that programs on this
  /// machine find each other.
  std::vector<std::string> interface_whitelist;
  std::string name = "nilio";
  std::uint32_t socket_buffer_bytes = 4 * 1024 * 1024;  ///< limited by net.core.rmem_max and wmem_max
};

/// DDS participant that uses UDP only. Shared memory is disabled: Fast DDS 2.9.1 aborts when processes with
/// other Fast DDS versions (ROS 2 Humble, Jazzy) use the same segments, and stops receiving after readers
/// were killed. Fast DDS XML profiles have no effect. Deletes all entities created in it.
class Participant {
 public:
  /// Fails if the domain is out of range or no listed address is on this machine.
  static core::Result<std::unique_ptr<Participant>> create(const ParticipantConfig& config);
  /// `conflicts` is told of the others' participants and writers; may be null.
  static core::Result<std::unique_ptr<Participant>> create(const ParticipantConfig& config,
                                                           std::unique_ptr<TopicConflicts> conflicts);
  ~Participant();
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;

  [[nodiscard]] eprosima::fastdds::dds::DomainParticipant& get() { return *participant_; }
  /// Listed addresses that were not on this machine at the start; they are not used.
  [[nodiscard]] const std::vector<std::string>& missing_interfaces() const { return missing_; }

  /// Lines for the log about other programs that publish the same; each once.
  std::vector<std::string> take_conflicts();

  enum class Refresh : std::uint8_t {
    kUnchanged,
    kRescanned,    ///< interfaces changed; the participant uses the new ones
    kNeedsRestart  ///< a missing listed address appeared: only a new participant can use it
  };
  /// Call periodically: Fast DDS does not detect new interfaces itself.
  Refresh refresh_interfaces();

 private:
  Participant();

  std::unique_ptr<TopicConflicts> conflicts_;  ///< outlives the participant that calls it
  eprosima::fastdds::dds::DomainParticipant* participant_ = nullptr;
  std::vector<std::string> whitelist_;
  std::vector<std::string> missing_;
  std::vector<std::string> addresses_;
};

/// Redirects Fast DDS's own messages (errors, from its own thread) from standard error to `handler`, at most
/// 10 lines per second, for the whole process.
void set_fastdds_log_handler(std::function<void(const std::string& line)> handler);

}  // namespace nilio::dds
