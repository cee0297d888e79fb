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

/// Topic names as DDS has them ("rt/" before the ROS name).
struct TopicNames {
  std::string odometry;      ///< rt/<prefix>/odom
  std::string transform;     ///< rt/tf: ROS knows only one
  std::string latency;       ///< rt/<prefix>/nilio/latency
  std::string scan_report;   ///< rt/<prefix>/nilio/scan_report
  std::string imu_odometry;  ///< rt/<prefix>/nilio/odometry_imu
  std::string imu_status;    ///< rt/<prefix>/nilio/odometry_imu_status
  std::string diagnostics;   ///< rt/diagnostics: one for all, too
};
/// Leading, trailing and doubled slashes of the prefix do not matter. Fails where ROS would not allow the
/// name.
core::Result<TopicNames> topic_names(const std::string& prefix);

struct ParticipantConfig {
  std::uint32_t domain = 0;  ///< 0..232, as ROS_DOMAIN_ID
  /// IPv4 addresses of the interfaces to use; empty: all. Loopback is always used, so that programs on this
  /// machine find each other.
  std::vector<std::string> interface_whitelist;
  std::string name = "nilio";
  std::uint32_t socket_buffer_bytes =
      4 * 1024 * 1024;  ///< the kernel caps it at net.core.rmem_max and wmem_max
};

/// A DDS participant that uses nothing but UDP. Shared memory stays off on purpose: Fast DDS 2.9.1 aborts
/// when processes with other Fast DDS versions (ROS 2 Humble, Jazzy) use the same segments, and goes deaf
/// after readers were killed. Not affected by Fast DDS XML profiles. Deletes what was created in it.
class Participant {
 public:
  /// Fails on a domain out of range and when none of the whitelisted addresses is on this machine.
  static core::Result<std::unique_ptr<Participant>> create(const ParticipantConfig& config);
  ~Participant();
  Participant(const Participant&) = delete;
  Participant& operator=(const Participant&) = delete;

  [[nodiscard]] eprosima::fastdds::dds::DomainParticipant& get() { return *participant_; }
  /// Whitelisted addresses that were not on this machine at the start and hence are not used.
  [[nodiscard]] const std::vector<std::string>& missing_interfaces() const { return missing_; }

  enum class Refresh : std::uint8_t {
    kUnchanged,
    kRescanned,    ///< interfaces changed, and the participant now uses the new ones
    kNeedsRestart  ///< a missing whitelisted address appeared: only a new participant can use it
  };
  /// To be called now and then: Fast DDS does not notice by itself that an interface came up.
  Refresh refresh_interfaces();

 private:
  Participant() = default;

  eprosima::fastdds::dds::DomainParticipant* participant_ = nullptr;
  std::vector<std::string> whitelist_;
  std::vector<std::string> missing_;
  std::vector<std::string> addresses_;
};

/// Sends what Fast DDS itself has to say (errors; from its own thread) to `handler` instead of standard
/// error, at most 10 lines a second, for the whole process.
void set_fastdds_log_handler(std::function<void(const std::string& line)> handler);

}  // namespace nilio::dds
