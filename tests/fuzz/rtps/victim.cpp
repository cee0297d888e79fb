#include "tests/fuzz/rtps/victim.hpp"

#include "ipc/dds/imu_pose_publisher.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/messages/diagnostics.hpp"

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <string>
#include <sys/prctl.h>
#include <thread>
#include <unistd.h>

namespace nilio::fuzz {

void run_victim(std::uint32_t domain) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  dds::set_fastdds_log_handler([](const std::string&) {});
  dds::OdometryPublisherConfig config;
  config.participant.domain = domain;
  config.participant.interface_whitelist = {"127.0.0.1"};
  auto publisher = dds::OdometryPublisher::create(config);
  if (!publisher) std::exit(2);
  auto imu_poses = dds::ImuPosePublisher::create(**publisher, config);
  auto subscriber = dds::OdometrySubscriber::create({.participant = config.participant, .topic_prefix = ""});
  if (!imu_poses || !subscriber) std::exit(2);
  if (write(STDOUT_FILENO, "r", 1) != 1) std::exit(2);
  ipc::PoseRecord record;
  ipc::ImuPose imu_pose;
  dds::LatencyReport latency;
  while (true) {
    record.stamp_ns += 20'000'000;
    ++record.sequence;
    (*publisher)->publish_odometry(record);
    (*publisher)->publish_transform(record);
    (*publisher)->publish_scan_report(dds::make_scan_report(record, {}, {}, "host"));
    (*publisher)->publish_latency(latency);
    (*publisher)->publish_diagnostics(dds::make_diagnostics({record, {}}, {}));
    (*imu_poses)->publish(imu_pose);
    (*imu_poses)->publish_status({});
    (*publisher)->participant().take_conflicts();
    while ((*subscriber)->next(core::Duration{0})) {
    }
    (*subscriber)->scan_reports();
    (*subscriber)->imu_statuses();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

bool receives_pose(std::uint32_t domain, core::Duration patience) {
  dds::OdometrySubscriberConfig config;
  config.participant.domain = domain;
  config.participant.interface_whitelist = {"127.0.0.1"};
  const auto subscriber = dds::OdometrySubscriber::create(config);
  return subscriber.ok() && (*subscriber)->next(patience);
}

}  // namespace nilio::fuzz
