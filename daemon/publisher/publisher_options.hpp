#pragma once

#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/imu_pose_stream.hpp"

#include <sys/types.h>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::daemon {

/// Command line of nilio-publisher, written by ipc::PublisherProcess.
struct PublisherOptions {
  int ring_descriptor = -1;
  int wake_descriptor = -1;
  pid_t parent = 0;
  int nice = 0;
  bool lock_memory = false;
  double wait_for_subscribers_s = 0.0;
  dds::OdometryPublisherConfig publisher;

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

/// `options` must outlive the parsing.
void add_publisher_options(CLI::App& app, PublisherOptions& options);

}  // namespace nilio::daemon
