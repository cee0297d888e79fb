// IMU-rate poses: from niliod's rings through nilio-publisher to a subscriber.
#include "daemon/publisher/imu_pose_loop.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/dds/types.hpp"
#include "tests/support/dds_support.hpp"
#include "tests/support/threads.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstdint>
#include <fstream>
#include <sched.h>
#include <sstream>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <vector>

namespace {

using namespace nilio;
using namespace nilio::tests;
using core::Duration;
using core::Time;
using dds::OdometrySubscriber;
using ipc::PublisherProcess;

constexpr std::int64_t kSampleNs = 5'000'000;

/// Scan at `stamp_ns` of a vehicle that drives 8 m/s along x.
ipc::PoseRecord moving_record(std::uint64_t sequence, std::int64_t stamp_ns, double off_m = 0.0) {
  ipc::PoseRecord record;
  record.sequence = sequence;
  record.stamp_ns = stamp_ns;
  record.scan_start_ns = stamp_ns - 100'000'000;
  record.position = {8e-9 * static_cast<double>(stamp_ns % 1'000'000'000'000), off_m, 0.0};
  record.linear_velocity = {8.0, 0.0, 0.0};
  record.imu_used = true;
  record.state = core::TrackingState::kTracking;
  record.stage_ns[static_cast<std::size_t>(ipc::Stage::kReceived)] = monotonic_ns() - 20'000'000;
  record.stage_ns[static_cast<std::size_t>(ipc::Stage::kDelivered)] = monotonic_ns();
  return record;
}

ipc::ImuRecord level_sample(std::int64_t stamp_ns) {
  return {{Time{stamp_ns}, {0.0, 0.0, 0.0}, {0.0, 0.0, 9.81}}, monotonic_ns()};
}

std::unique_ptr<OdometrySubscriber> imu_subscriber(std::uint32_t domain) {
  auto subscriber =
      OdometrySubscriber::create({.participant = loopback(domain), .topic_prefix = "", .imu_rate = true});
  if (!subscriber) FAIL(subscriber.error().message);
  return std::move(subscriber).value();
}

std::unique_ptr<PublisherProcess> imu_process(const std::filesystem::path& executable, std::uint32_t domain) {
  ipc::PublisherProcessConfig config = process_config(executable, domain);
  config.imu_poses.emplace();
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  return std::move(process).value();
}

/// Locked memory in KiB as counted by the kernel.
long locked_kib(pid_t process) {
  std::ifstream status("/proc/" + std::to_string(process) + "/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmLck:")) return std::stol(line.substr(6));
  }
  return 0;
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
// mlockall() has no effect with sanitizers.
constexpr bool kLocksMemory = false;
#else
constexpr bool kLocksMemory = true;
#endif

/// Pushes scans and samples until the subscriber has received the status of a scan and the pose of a sample:
/// it has then discovered both writers, and no message is in transit. Returns the stamp of the last sample.
std::int64_t connect(PublisherProcess& process, OdometrySubscriber& subscriber, std::int64_t stamp_ns) {
  const auto is_received = [&](std::int64_t scan_stamp_ns) {
    constexpr Duration wait = Duration::from_milliseconds(100.0);
    auto pose = subscriber.next(wait);
    while (pose && pose->message.stamp.ns != stamp_ns) pose = subscriber.next(wait);
    const auto statuses = subscriber.imu_statuses();
    return pose && !statuses.empty() && statuses.back().scan_stamp.ns == scan_stamp_ns;
  };
  REQUIRE(eventually([&] {
    const std::int64_t scan_stamp_ns = stamp_ns;
    REQUIRE(process.publish(moving_record(0, scan_stamp_ns)));
    stamp_ns += kSampleNs;
    REQUIRE(process.publish_sample(level_sample(stamp_ns)));
    return is_received(scan_stamp_ns);
  }));
  return stamp_ns;
}

}  // namespace

TEST_CASE("the IMU-rate pose thread has the requested priority, and memory is locked", "[imu_poses]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  if (!may_have_fifo()) {
    WARN("skipped: no permission for FIFO threads");
    return;
  }
  const std::uint32_t domain = test_domain();
  ipc::PublisherProcessConfig config = process_config(*executable, domain);
  config.imu_poses.emplace();
  config.imu_pose_priority = 7;
  config.lock_memory = true;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  const auto pid = (*process)->start();
  REQUIRE(pid.ok());
  std::vector<pid_t> threads;
  REQUIRE(eventually([&] {
    threads = threads_named(std::to_string(*pid), "imu-poses");
    return threads.size() == 1 && sched_getscheduler(threads[0]) == SCHED_FIFO;
  }));
  sched_param parameters{};
  REQUIRE(sched_getparam(threads[0], &parameters) == 0);
  CHECK(parameters.sched_priority == 7);
  CHECK(sched_getscheduler(*pid) == SCHED_OTHER);
  if (kLocksMemory) CHECK(locked_kib(*pid) > 0);
}

TEST_CASE("IMU-rate poses continue while scans are missing for seconds, one per sample", "[imu_poses]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = imu_subscriber(domain);
  const auto process = imu_process(*executable, domain);
  std::int64_t stamp_ns = connect(*process, *subscriber, 1'767'268'800'000'000'000);
  // A registration that takes two seconds: 400 samples, then its pose.
  std::vector<std::int64_t> sent;
  std::vector<std::int64_t> received;
  const auto receive = [&](Duration wait) {
    while (const auto message = subscriber->next(wait)) {
      received.push_back(message->message.stamp.ns);
      const double expected = 8e-9 * static_cast<double>(message->message.stamp.ns % 1'000'000'000'000);
      CHECK(message->message.position[0] == Approx(expected).margin(1e-3));
      CHECK(message->message.frame_id == "odom");
      CHECK(message->message.child_frame_id == "base_link");
    }
  };
  for (int i = 0; i < 400; ++i) {
    stamp_ns += kSampleNs;
    sent.push_back(stamp_ns);
    REQUIRE(process->publish_sample(level_sample(stamp_ns)));
    receive(Duration{kSampleNs});
  }
  CHECK(eventually([&] {
    receive(Duration::from_milliseconds(100.0));
    return received.size() >= sent.size();
  }));
  CHECK(received == sent);
  CHECK(subscriber->counts().lost == 0);
  CHECK(process->samples().dropped() == 0);
}

TEST_CASE("the correction of a new scan is slewed within the limits, and a jump is flagged with its stamp",
          "[imu_poses]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = imu_subscriber(domain);
  const auto process = imu_process(*executable, domain);
  std::int64_t stamp_ns = connect(*process, *subscriber, 1'767'268'800'000'000'000);
  std::vector<dds::Odometry> poses;
  const auto run = [&](int samples) {
    for (int i = 0; i < samples; ++i) {
      stamp_ns += kSampleNs;
      REQUIRE(process->publish_sample(level_sample(stamp_ns)));
      const auto pose = subscriber->next(kPatience);
      REQUIRE(pose.has_value());
      REQUIRE(pose->message.stamp.ns == stamp_ns);
      poses.push_back(pose->message);
    }
  };
  run(20);
  REQUIRE(process->publish(moving_record(1, stamp_ns, 0.3)));
  run(100);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const double seconds = static_cast<double>((poses[i].stamp - poses[i - 1].stamp).ns) * 1e-9;
    const double sideways = std::abs(poses[i].position[1] - poses[i - 1].position[1]);
    REQUIRE(sideways <= core::PoseSlewLimits{}.max_slew_m_s * seconds + 1e-12);
  }
  CHECK(poses.back().position[1] == Approx(0.3).margin(0.03));

  REQUIRE(process->publish(moving_record(2, stamp_ns, 5.0)));
  const std::int64_t before_jump_ns = stamp_ns;
  run(1);
  CHECK(poses.back().position[1] == Approx(5.0).margin(1e-6));
  std::vector<dds::ImuPoseStatus> statuses;
  CHECK(eventually([&] {
    for (const auto& status : subscriber->imu_statuses()) statuses.push_back(status);
    return statuses.size() >= 2;
  }));
  REQUIRE(statuses.size() == 2);
  CHECK_FALSE(statuses[0].jumped);
  CHECK(statuses[0].correction_m == Approx(0.3).margin(1e-3));
  CHECK(statuses[0].scan_sequence == 1);
  CHECK(statuses[1].jumped);
  CHECK(statuses[1].jumps == 1);
  CHECK(statuses[1].stamp.ns == before_jump_ns);
  CHECK(statuses[1].follows_gyro);
}

TEST_CASE("a restarted publisher continues with the waiting samples and its counters are complete",
          "[imu_poses]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto process = imu_process(*executable, domain);
  constexpr std::uint64_t samples = 300;
  REQUIRE(process->publish(moving_record(0, 1'767'268'800'000'000'000)));
  for (std::uint64_t i = 1; i <= samples; ++i) {
    REQUIRE(process->publish_sample(
        level_sample(1'767'268'800'000'000'000 + static_cast<std::int64_t>(i) * kSampleNs)));
    if (i == samples / 2) {
      REQUIRE(eventually([&] { return process->samples().size() == 0; }));
      kill(process->pid(), SIGKILL);
      // Waits until the process has ended; its exit status is left to the supervisor.
      siginfo_t ignored{};
      REQUIRE(waitid(P_PID, static_cast<id_t>(process->pid()), &ignored, WEXITED | WNOWAIT) == 0);
    }
  }
  CHECK(process->samples().written() == samples);
  CHECK(process->samples().size() == samples / 2);
  CHECK(eventually([&] {
    process->poll();
    return process->samples().size() == 0;
  }));
  CHECK(process->restarts() == 1);
  CHECK(process->samples().consumed() == samples);
  CHECK(process->samples().dropped() == 0);
}

TEST_CASE("a stopped publisher has published a pose for every sample and reports their latencies",
          "[imu_poses]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  const auto process = imu_process(*executable, domain);
  REQUIRE(process->publish(moving_record(0, 1'767'268'800'000'000'000)));
  // Waits until the reports arrive; earlier messages may be missing.
  REQUIRE(eventually([&] { return subscriber->latency_report().has_value(); }));
  constexpr std::uint64_t samples = 500;
  for (std::uint64_t i = 1; i <= samples; ++i)
    REQUIRE(process->publish_sample(
        level_sample(1'767'268'800'000'000'000 + static_cast<std::int64_t>(i) * kSampleNs)));
  const auto stopped = process->stop(kPatience);
  REQUIRE(stopped.has_value());
  CHECK(stopped->exit_status == 0);
  CHECK(process->samples().size() == 0);
  std::optional<dds::LatencyReport> report;
  // The last report; one is sent every second.
  CHECK(eventually([&] {
    report = subscriber->latency_report();
    return report && report->imu_poses_published >= samples;
  }));
  REQUIRE(report.has_value());
  CHECK(report->imu_poses_published == samples);
  CHECK(report->failed_writes == 0);
  CHECK(report->imu_ring_dropped == 0);
  REQUIRE(report->stages.back().name == "imu_received_to_written");
  CHECK(report->stages[report->stages.size() - 2].name == "imu_write");
  CHECK(report->stages[report->stages.size() - 2].count == samples);
  std::uint64_t in_buckets = 0;
  for (const dds::LatencyBucket& bucket : report->stages[report->stages.size() - 2].buckets) {
    CHECK(bucket.from_us < bucket.to_us);
    in_buckets += bucket.count;
  }
  CHECK(in_buckets == samples);
}

TEST_CASE("every scan report has its stages in order and the host id of this machine", "[imu_poses]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  ipc::PublisherProcessConfig config = process_config(*executable, domain);
  config.wait_for_subscribers = kPatience;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  std::vector<dds::ScanReport> reports;
  std::uint64_t sequence = 0;
  for (; sequence < 3000 && reports.size() < 5;
       ++sequence) {  // the reports' own reader may be discovered later
    ipc::PoseRecord record = sample_record(sequence);
    record.state = core::TrackingState::kDegraded;
    record.stop_reason = core::StopReason::kMaxIterations;
    record.lost_packets = 7;
    record.superseded = 3;
    record.degradation_level = core::DegradationLevel::kIcpOnly;
    record.guarded = true;
    record.has_deadline = true;
    record.overshoot_ns = -12;
    REQUIRE((*process)->publish(record));
    REQUIRE(subscriber->next(kPatience).has_value());
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    for (const auto& report : subscriber->scan_reports()) reports.push_back(report);
  }
  REQUIRE(reports.size() >= 5);
  CHECK_FALSE(dds::read_host_id().empty());
  for (std::size_t i = 0; i < reports.size(); ++i) {
    const dds::ScanReport& report = reports[i];
    CHECK(report.sequence == reports[0].sequence + i);
    CHECK(report.stamp.ns == sample_record(report.sequence).stamp_ns);
    CHECK(report.state == "degraded");
    CHECK(report.stop_reason == core::name_of(core::StopReason::kMaxIterations));
    CHECK(report.lost_packets == 7);
    CHECK(report.superseded == 3);
    CHECK(report.degradation_level == core::name_of(core::DegradationLevel::kIcpOnly));
    CHECK(report.guarded);
    CHECK(report.overshoot_ns == -12);
    CHECK(report.host_id == dds::read_host_id());
    REQUIRE(report.stages.size() == 10);
    CHECK(report.stages.front().name == "received");
    CHECK(report.stages.back().name == "written");
    for (std::size_t k = 1; k < report.stages.size(); ++k)
      CHECK(report.stages[k].monotonic_ns >= report.stages[k - 1].monotonic_ns);
  }
}

TEST_CASE("CycloneDDS reads IMU-rate poses, their status and scan reports from the IDL with equal fields",
          "[imu_poses]") {
  const auto reader_program = built_program("nilio-cyclone-reader");
  if (!reader_program) return;
  const std::uint32_t domain = test_domain();
  const auto publisher = make_publisher(domain);
  dds::OdometryPublisherConfig config;
  auto imu = dds::ImuPosePublisher::create(*publisher, config);
  REQUIRE(imu.ok());
  Program reader(kCycloneLoopback + reader_program->string() + " " + std::to_string(domain) + " 20 30 imu");
  REQUIRE(wait_for_subscriber(**imu));
  REQUIRE(reader.line() == "ready");
  const dds::ScanReport report = dds::make_scan_report(sample_record(3), Time{11}, Time{12}, "host");
  const dds::ImuPoseStatus status{{5}, {4}, 6, 0.25, -0.125, true, false, 7, 8, 9, 10};
  ipc::ImuPose pose;
  pose.T_odom_base = {Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5), core::Vector3(1.5, -2.5, 1e-9)};
  pose.linear_velocity = {3.0, 0.1, -0.2};
  pose.angular_velocity = {0.01, 0.02, 0.03};
  for (std::size_t i = 0; i < 36; ++i) {
    pose.pose_covariance[i] = 0.1 * static_cast<double>(i);
    pose.twist_covariance[i] = -0.3 * static_cast<double>(i);
  }
  for (std::int64_t i = 0; i < 20; ++i) {
    pose.stamp = {i * 1'000'000'001};
    REQUIRE((*imu)->publish(pose));
    // Discovery of the three readers ends in any order, and reports and states before it are not repeated.
    REQUIRE(publisher->publish_scan_report(report));
    REQUIRE((*imu)->publish_status(status));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  std::int64_t poses = 0;
  int statuses = 0;
  int reports = 0;
  while (const auto line = reader.line()) {
    std::istringstream in(*line);
    std::string kind;
    in >> kind;
    if (kind == "odometry") {
      pose.stamp = {poses++ * 1'000'000'001};
      dds::Odometry expected;
      expected.frame_id = "odom";
      expected.child_frame_id = "base_link";
      dds::fill_odometry(pose, expected);
      CHECK(parse_odometry(in) == expected);
    } else if (kind == "status") {
      ++statuses;
      CHECK(*line == "status 0 5 0 4 6 0x1p-2 -0x1p-3 1 0 7 8 9 10");
    } else if (kind == "report") {
      ++reports;
      std::string expected = "report 3 [initialising] [converged] [host]";
      for (const dds::StageStamp& stage : report.stages)
        expected += " [" + stage.name + "=" + std::to_string(stage.monotonic_ns) + "]";
      CHECK(*line == expected + " 0 0 0 0 0 0 0 0 0 0 0 0 0 [full] 0 0");
    }
  }
  CHECK(poses == 20);
  CHECK(statuses > 0);
  CHECK(reports > 0);
  CHECK(reader.exit_status() == 0);
}
