#include "daemon/publisher/publisher_options.hpp"

namespace nilio::daemon {

namespace {

void add_options(CLI::App& app, PublisherOptions& options) {
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
  app.add_flag("--lock-memory", options.lock_memory, "Keep all memory of this process resident");
  app.add_option("--wait-for-subscribers", options.wait_for_subscribers_s,
                 "Seconds to wait for a first subscriber before reading the ring")
      ->check(CLI::Range(0.0, 3600.0));
}

void add_imu_options(CLI::App& app, PublisherOptions& options) {
  app.add_flag("--imu-rate", options.imu_rate, "Publish a pose for every IMU sample, too");
  app.add_option("--imu-priority", options.imu_priority,
                 "SCHED_FIFO priority of the thread that does; 0: none")
      ->check(CLI::Range(0, 99));
  app.add_option("--imu-pose-ring-fd", options.imu_pose_ring_descriptor,
                 "Inherited memfd of the poses' second ring");
  app.add_option("--imu-ring-fd", options.imu_ring_descriptor, "Inherited memfd of the ring of samples");
  app.add_option("--imu-wake-fd", options.imu_wake_descriptor,
                 "Inherited eventfd, signalled when either of these has something");
  app.add_option("--imu-orientation", options.imu_orientation_xyzw,
                 "Mounting of the IMU on the vehicle, quaternion x,y,z,w")
      ->delimiter(',')
      ->expected(4);
  app.add_option("--imu-position", options.imu_position, "The same, place x,y,z in m")
      ->delimiter(',')
      ->expected(3);
  ipc::ImuPoseConfig& poses = options.imu_poses;
  const auto add = [&](const char* name, double& value, const char* text) {
    app.add_option(name, value, text)->check(CLI::NonNegativeNumber);
  };
  add("--imu-max-gap", options.imu_max_gap_s, "Seconds between samples that the gyro is used across");
  add("--imu-max-age", options.imu_max_age_s, "Seconds after a scan up to which poses are propagated");
  add("--imu-rate-max-hz", poses.max_rate_hz, "Poses per second; 0: one for every sample");
  add("--imu-max-slew", poses.slew.max_slew_m_s, "Speed with which corrections are worked off, m/s");
  add("--imu-max-turn-slew", poses.slew.max_slew_rad_s, "The same for the rotation, rad/s");
  add("--imu-settle", options.imu_settle_s, "Time constant of corrections, seconds");
  add("--imu-jump", poses.slew.jump_m, "A larger correction is made at once, m");
  add("--imu-turn-jump", poses.slew.jump_rad, "The same for the rotation, rad");
}

}  // namespace

void add_publisher_options(CLI::App& app, PublisherOptions& options) {
  add_options(app, options);
  add_imu_options(app, options);
}

}  // namespace nilio::daemon
