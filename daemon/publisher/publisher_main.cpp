// nilio-publisher: reads poses from the ring shared with niliod and publishes them over DDS. It is a separate
// process because Fast DDS may abort on a malformed datagram, allocate or block; none of this reaches the
// estimator.

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include "daemon/child_process.hpp"
#include "daemon/command_line.hpp"
#include "daemon/log_format.hpp"
#include "daemon/publisher/cloud_loop.hpp"
#include "daemon/publisher/imu_pose_loop.hpp"
#include "daemon/publisher/publisher_loop.hpp"
#include "daemon/publisher/scan_pose_loop.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/kernel_requests.hpp"
#include "ipc/publisher_process.hpp"
#include "ipc/publisher_state.hpp"
#include "ipc/records.hpp"
#include "ipc/ring.hpp"
#include "ipc/shared_object.hpp"
#include "ipc/wake_event.hpp"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <malloc.h>
#include <memory>
#include <pthread.h>
#include <string>
#include <sys/resource.h>
#include <sys/types.h>
#include <unistd.h>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

namespace nilio::daemon {
namespace {

using core::Duration;

/// Command line of nilio-publisher, written by ipc::PublisherProcess.
struct PublisherOptions {
  int ring_descriptor = -1;
  int wake_descriptor = -1;
  int state_descriptor = -1;
  pid_t parent = 0;
  int nice = 0;
  int priority = 0;
  bool lock_memory = false;
  double wait_for_subscribers_s = 0.0;
  dds::OdometryPublisherConfig publisher;

  int scan_ring_descriptor = -1;
  int path_ring_descriptor = -1;
  int cloud_wake_descriptor = -1;
  dds::CloudLimits clouds;

  bool imu_rate = false;
  int imu_priority = 0;
  int imu_pose_ring_descriptor = -1;
  int imu_ring_descriptor = -1;
  int imu_wake_descriptor = -1;
  std::vector<double> imu_orientation_xyzw{0.0, 0.0, 0.0, 1.0};
  std::vector<double> imu_position{0.0, 0.0, 0.0};
  double imu_max_gap_s = 0.0;
  double imu_max_age_s = 0.0;
  double imu_settle_s = 0.0;
  ipc::ImuPoseConfig imu_poses;
};

void add_publisher_options(CLI::App& app, PublisherOptions& options) {
  dds::OdometryPublisherConfig& publisher = options.publisher;
  app.add_option("--ring-fd", options.ring_descriptor, "Inherited memfd of the pose ring")->required();
  app.add_option("--wake-fd", options.wake_descriptor, "Inherited eventfd, signalled when there are poses")
      ->required();
  app.add_option("--state-fd", options.state_descriptor, "Inherited memfd of this process's counters")
      ->required();
  app.add_option("--parent-pid", options.parent, "Parent process; exit when it exits");
  app.add_option("--domain", publisher.participant.domain, "DDS domain id")->check(CLI::Range(0, 232));
  app.add_option("--interface", publisher.participant.interface_whitelist,
                 "IPv4 address of an interface for DDS (repeatable; default: all)");
  app.add_option("--odom-frame", publisher.odom_frame, "Frame of the poses");
  app.add_option("--base-frame", publisher.base_frame, "Frame of the vehicle");
  app.add_option("--topic-prefix", publisher.topic_prefix, "Prefix of the topic names");
  app.add_flag("!--no-transform", publisher.transform, "Do not publish the transform of the pose");
  app.add_option("--nice", options.nice, "Nice value of this process")->check(CLI::Range(-20, 19));
  app.add_option("--priority", options.priority,
                 "SCHED_FIFO priority of the scan pose thread; 0: no thread is FIFO")
      ->check(CLI::Range(0, 99));
  app.add_flag("--lock-memory", options.lock_memory, "Keep all memory of this process resident");
  app.add_option("--wait-for-subscribers", options.wait_for_subscribers_s,
                 "Maximum wait for a first subscriber before reading the ring, s")
      ->check(CLI::Range(0.0, 3600.0));
}

void add_cloud_options(CLI::App& app, PublisherOptions& options) {
  app.add_option("--scan-ring-fd", options.scan_ring_descriptor,
                 "Inherited memfd of the ring of registered scans");
  app.add_option("--path-ring-fd", options.path_ring_descriptor, "Inherited memfd of the poses of the path");
  app.add_option("--cloud-wake-fd", options.cloud_wake_descriptor, "Inherited eventfd of registered scans");
  app.add_option("--scan-points", options.clouds.scan_points,
                 "Maximum points of a registered scan; 0: no scans")
      ->check(CLI::Range(std::size_t{0}, ipc::ScanCloud::kCapacity));
  app.add_option("--scan-rate-max-hz", options.clouds.scan_rate_max_hz,
                 "Maximum rate of registered scans, Hz")
      ->check(CLI::PositiveNumber);
  app.add_option("--path-poses", options.clouds.path_poses, "Maximum poses of the path; 0: no path")
      ->check(CLI::Range(std::size_t{0}, ipc::kMaxPathPoses));
}

void add_imu_options(CLI::App& app, PublisherOptions& options) {
  app.add_flag("--imu-rate", options.imu_rate, "Also publish a pose for every IMU sample");
  app.add_option("--imu-priority", options.imu_priority,
                 "SCHED_FIFO priority of the IMU-rate pose thread; 0: none")
      ->check(CLI::Range(0, 99));
  app.add_option("--imu-pose-ring-fd", options.imu_pose_ring_descriptor,
                 "Inherited memfd of the second pose ring");
  app.add_option("--imu-ring-fd", options.imu_ring_descriptor, "Inherited memfd of the IMU sample ring");
  app.add_option("--imu-wake-fd", options.imu_wake_descriptor, "Inherited eventfd of these two rings");
  app.add_option("--imu-orientation", options.imu_orientation_xyzw,
                 "Mounting of the IMU on the vehicle, quaternion x,y,z,w")
      ->delimiter(',')
      ->expected(4);
  app.add_option("--imu-position", options.imu_position,
                 "Mounting of the IMU on the vehicle, position x,y,z in m")
      ->delimiter(',')
      ->expected(3);
  ipc::ImuPoseConfig& poses = options.imu_poses;
  const auto add = [&](const char* name, double& value, const char* text) {
    app.add_option(name, value, text)->check(CLI::NonNegativeNumber);
  };
  add("--imu-max-gap", options.imu_max_gap_s, "Maximum gap between samples that is bridged with the gyro, s");
  add("--imu-max-age", options.imu_max_age_s, "Maximum propagation time after a scan, s");
  add("--imu-rate-max-hz", poses.max_rate_hz, "Maximum pose rate, Hz; 0: one pose per sample");
  add("--imu-max-slew", poses.slew.max_slew_m_s, "Maximum slew rate of position corrections, m/s");
  add("--imu-max-turn-slew", poses.slew.max_slew_rad_s, "Maximum slew rate of rotation corrections, rad/s");
  add("--imu-settle", options.imu_settle_s, "Time constant of corrections, s");
  add("--imu-jump", poses.slew.jump_m, "Larger position corrections are applied at once, m");
  add("--imu-turn-jump", poses.slew.jump_rad, "Larger rotation corrections are applied at once, rad");
}

// Nice offset of the pose threads relative to the rest of the process, where FIFO is not granted.
constexpr int kPoseNice = -5;
constexpr int kMinNice = -20;
// FIFO priority of the main thread and of Fast DDS's threads. They share Fast DDS's locks with the pose
// threads, which must not wait for a thread that a normal process keeps from running; a flood of datagrams
// must not keep the pose threads from running either. Therefore above every normal thread and below every
// other FIFO thread.
constexpr int kDdsPriority = 1;

/// Locks all memory, including the thread stacks. Call before any thread is started. Unlike in niliod,
/// threads keep separate malloc arenas, so that the IMU-rate poses do not wait for another thread's lock.
void lock_memory() {
  pthread_attr_t attributes;
  pthread_attr_init(&attributes);
  // Applies to Fast DDS's threads, too; the default of 8 MiB would be locked completely.
  pthread_attr_setstacksize(&attributes, ipc::kThreadStackBytes);
  pthread_setattr_default_np(&attributes);
  pthread_attr_destroy(&attributes);
  mallopt(M_TRIM_THRESHOLD, -1);
  if (const std::string refused = ipc::request_memory_lock(); !refused.empty())
    spdlog::warn("memory: {}", refused);
}

/// Raises the priority of the calling pose thread above the rest of the process.
void take_precedence(const char* thread, int fifo_priority, int process_nice) {
  if (fifo_priority > 0) {
    const std::string refused = ipc::request_fifo(fifo_priority);
    if (refused.empty()) {
      spdlog::info("{}: FIFO {}", thread, fifo_priority);
      return;
    }
    spdlog::warn("{}: {}", thread, refused);
  }
  // On Linux this affects only the calling thread. Without the privilege the process has logged a warning
  // already.
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), std::max(process_nice + kPoseNice, kMinNice));
}

/// Normal priority for the calling thread.
void leave_precedence() {
  ipc::leave_fifo();
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), 0);
}

core::Result<dds::ScanPoseInputs> attach_scan_poses(const PublisherOptions& options) {
  auto poses = ipc::Ring<ipc::PoseRecord>::attach(options.ring_descriptor);
  if (!poses) return poses.error();
  auto wake = ipc::WakeEvent::adopt(options.wake_descriptor);
  if (!wake) return wake.error();
  auto state = ipc::SharedObject<ipc::PublisherState>::attach(options.state_descriptor);
  if (!state) return state.error();
  return dds::ScanPoseInputs{std::move(poses).value(), std::move(wake).value(), std::move(state).value()};
}

/// Null without IMU-rate poses; fails if an inherited descriptor is missing.
core::Result<std::unique_ptr<dds::ImuPoseLoop>> make_imu_poses(const PublisherOptions& options,
                                                               dds::OdometryPublisher& publisher) {
  if (!options.imu_rate) return std::unique_ptr<dds::ImuPoseLoop>();
  auto poses = ipc::Ring<ipc::PoseRecord>::attach(options.imu_pose_ring_descriptor);
  if (!poses) return poses.error();
  auto samples = ipc::Ring<ipc::ImuRecord>::attach(options.imu_ring_descriptor);
  if (!samples) return samples.error();
  auto wake = ipc::WakeEvent::adopt(options.imu_wake_descriptor);
  if (!wake) return wake.error();
  auto writers = dds::ImuPosePublisher::create(publisher, options.publisher);
  if (!writers) return writers.error();
  ipc::ImuPoseConfig config = options.imu_poses;
  const auto& q = options.imu_orientation_xyzw;
  config.propagation.T_base_imu.rotation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized();
  config.propagation.T_base_imu.translation = core::Vector3(options.imu_position.data());
  config.propagation.max_gap = Duration::from_seconds(options.imu_max_gap_s);
  config.propagation.max_age = Duration::from_seconds(options.imu_max_age_s);
  config.slew.settle = Duration::from_seconds(options.imu_settle_s);
  return std::make_unique<dds::ImuPoseLoop>(
      dds::ImuPoseInputs{std::move(poses).value(), std::move(samples).value(), std::move(wake).value()},
      config, std::move(writers).value());
}

/// Null if it is impossible: poses are published without clouds, too.
std::unique_ptr<dds::CloudPublisher> make_cloud_publisher(const dds::OdometryPublisherConfig& config) {
  auto publisher = dds::CloudPublisher::create({config.participant, config.odom_frame, config.topic_prefix});
  if (publisher) return std::move(publisher).value();
  spdlog::warn("registered scans and path: not published: {}", publisher.error().message);
  return nullptr;
}

/// Null if there is nothing to publish, or an inherited descriptor is missing.
std::unique_ptr<dds::CloudLoop> make_clouds(const PublisherOptions& options) {
  if (options.clouds.scan_points == 0 && options.clouds.path_poses == 0) return nullptr;
  auto scans = ipc::OverwritingRing<ipc::ScanCloud>::attach(options.scan_ring_descriptor);
  auto path = ipc::OverwritingRing<ipc::PathPose>::attach(options.path_ring_descriptor);
  auto wake = ipc::WakeEvent::adopt(options.cloud_wake_descriptor);
  if (!scans || !path || !wake) {
    spdlog::warn("registered scans and path: not published: {}", (!scans  ? scans.error()
                                                                  : !path ? path.error()
                                                                          : wake.error())
                                                                     .message);
    return nullptr;
  }
  return std::make_unique<dds::CloudLoop>(
      dds::CloudInputs{std::move(scans).value(), std::move(path).value(), std::move(wake).value()},
      [config = options.publisher] { return make_cloud_publisher(config); }, options.clouds);
}

/// The DDS entities and the loops that use them.
struct Publishing {
  std::unique_ptr<dds::OdometryPublisher> publisher;
  std::unique_ptr<dds::ScanPoseLoop> scan_poses;
  std::unique_ptr<dds::ImuPoseLoop> imu_poses;
  std::unique_ptr<dds::CloudLoop> clouds;
};

/// Creates everything, starts nothing of its own. Fast DDS's threads inherit the calling thread's scheduling.
core::Result<Publishing> create_publishing(const PublisherOptions& options) {
  auto inputs = attach_scan_poses(options);
  if (!inputs) return core::Error{"inherited descriptors: " + inputs.error().message};
  auto publisher = dds::OdometryPublisher::create(options.publisher);
  if (!publisher) return publisher.error();
  auto imu_poses = make_imu_poses(options, **publisher);
  if (!imu_poses) return core::Error{"IMU-rate poses: " + imu_poses.error().message};
  auto scan_poses = std::make_unique<dds::ScanPoseLoop>(std::move(inputs).value(), **publisher);
  return Publishing{std::move(publisher).value(), std::move(scan_poses), std::move(imu_poses).value(),
                    nullptr};
}

int run(const PublisherOptions& options) {
  const int signals = take_signals();
  if (signals < 0) {
    spdlog::error("signalfd: {}", std::strerror(errno));
    return kFailed;
  }
  if (!end_with_parent(options.parent)) {
    spdlog::warn("--parent-pid {}: not the parent of this process, which has ended; exiting", options.parent);
    return kFailed;
  }
  if (options.lock_memory) lock_memory();
  // Inherited by the threads of Fast DDS.
  if (options.nice != 0 && setpriority(PRIO_PROCESS, 0, options.nice) != 0)
    spdlog::warn("no privilege for nice {} (CAP_SYS_NICE or LimitNICE= in the unit): running at 0",
                 options.nice);

  dds::set_fastdds_log_handler([](const std::string& line) { spdlog::warn("{}", line); });
  if (options.priority > 0) {
    if (const std::string refused = ipc::request_fifo(kDdsPriority); !refused.empty())
      spdlog::warn("reports and DDS: {}", refused);
  }
  auto publishing = create_publishing(options);
  if (!publishing) {
    spdlog::error("{}", publishing.error().message);
    return kFailed;
  }
  for (const std::string& address : publishing->publisher->participant().missing_interfaces())
    spdlog::warn("DDS interface {}: not on this machine yet; not used", address);
  publishing->scan_poses->start([&options] { take_precedence("scan-poses", options.priority, options.nice); },
                                Duration::from_seconds(options.wait_for_subscribers_s));
  if (publishing->imu_poses)
    publishing->imu_poses->start(
        [&options] { take_precedence("imu-poses", options.imu_priority, options.nice); });
  publishing->clouds = make_clouds(options);
  if (publishing->clouds) publishing->clouds->start(leave_precedence);
  spdlog::info("publishing on DDS domain {}", options.publisher.participant.domain);
  return PublisherLoop(options.parent, signals, std::move(publishing->publisher),
                       std::move(publishing->scan_poses), std::move(publishing->imu_poses),
                       std::move(publishing->clouds))
      .run();
}

}  // namespace
}  // namespace nilio::daemon

int main(int argc, char** argv) {
  CLI::App app{"Publishes the poses of niliod over DDS. Started by niliod."};
  app.formatter(std::make_shared<nilio::HelpFormatter>());
  app.footer(nilio::exit_status_help("nilio-publisher"));
  nilio::daemon::PublisherOptions options;
  options.publisher.participant.name = "nilio";
  nilio::daemon::add_publisher_options(app, options);
  nilio::daemon::add_cloud_options(app, options);
  nilio::daemon::add_imu_options(app, options);
  if (const auto status = nilio::parse_command_line(app, argc, argv)) return *status;
  spdlog::set_default_logger(spdlog::stderr_logger_mt("nilio-publisher"));
  spdlog::set_formatter(nilio::log_formatter("nilio-publisher", STDERR_FILENO));
  return nilio::daemon::run(options);
}
