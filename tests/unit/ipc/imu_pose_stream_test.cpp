#include "ipc/imu_pose_stream.hpp"

#include <cmath>
#include <cstdint>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::ipc;
using nilio::core::Duration;
using nilio::core::Time;
using nilio::core::Vector3;

namespace {

constexpr std::int64_t kMs = 1'000'000;
constexpr std::int64_t kStartNs = 1'767'268'800'000'000'000;

/// Straight motion at 10 m/s; the scan poses have a lateral offset.
PoseRecord scan_record(std::uint64_t sequence, std::int64_t ms, double off_m = 0.0) {
  PoseRecord record;
  record.sequence = sequence;
  record.stamp_ns = kStartNs + ms * kMs;
  record.position = {0.01 * static_cast<double>(ms), off_m, 0.0};
  record.linear_velocity = {10.0, 0.0, 0.0};
  record.imu_used = true;
  for (std::size_t i = 0; i < 6; ++i) {
    record.pose_covariance[7 * i] = 1e-4;
    record.twist_covariance[7 * i] = 1e-2;
  }
  return record;
}

ImuRecord sample_record(std::int64_t ms) {
  return {{Time{kStartNs + ms * kMs}, {0.0, 0.0, 0.0}, {0.0, 0.0, 9.81}}, ms * kMs};
}

}  // namespace

TEST_CASE("every sample after the first scan yields exactly one pose with its stamp", "[imu_pose_stream]") {
  ImuPoseStream stream({});
  std::vector<ImuPose> poses;
  for (std::int64_t ms = 5; ms <= 10'000; ms += 5) {
    // Scans end every 100 ms and arrive 30 ms later.
    if (ms >= 130 && ms % 100 == 30) stream.add(scan_record(static_cast<std::uint64_t>(ms / 100), ms - 30));
    if (const auto pose = stream.add(sample_record(ms))) poses.push_back(*pose);
  }
  const ImuPoseCounts counts = stream.counts();
  CHECK(counts.samples == 2000);
  CHECK(counts.withheld == 25);  // no scan pose up to 125 ms
  CHECK(counts.published == 1975);
  CHECK(counts.thinned == 0);
  CHECK(counts.scan_poses == 99);
  REQUIRE(poses.size() == counts.published);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const auto ms = 130 + 5 * static_cast<std::int64_t>(i);
    REQUIRE(poses[i].stamp.ns == kStartNs + ms * kMs);
    REQUIRE(poses[i].received_ns == ms * kMs);
    REQUIRE((poses[i].T_odom_base.translation - Vector3(0.01 * static_cast<double>(ms), 0.0, 0.0)).norm() <
            1e-6);
  }
}

TEST_CASE("a scan that takes seconds does not interrupt the poses, and its correction is slewed",
          "[imu_pose_stream]") {
  ImuPoseConfig config;
  config.slew.max_slew_m_s = 0.4;
  ImuPoseStream stream(config);
  stream.add(scan_record(0, 0));
  std::optional<Vector3> last;
  int poses = 0;
  double largest_step_m = 0.0;
  for (std::int64_t ms = 5; ms <= 4000; ms += 5) {
    if (ms == 3005) {
      const ImuPoseUpdate update = stream.add(scan_record(1, 100, 0.5));
      CHECK(update.scan_sequence == 1);
      CHECK(update.stamp.ns == kStartNs + 3000 * kMs);
      CHECK(update.correction.distance_m == Approx(0.5).margin(1e-6));
      CHECK_FALSE(update.correction.jumped);
    }
    const auto pose = stream.add(sample_record(ms));
    REQUIRE(pose.has_value());
    ++poses;
    if (last)
      largest_step_m = std::max(largest_step_m, std::abs(pose->T_odom_base.translation.y() - last->y()));
    last = pose->T_odom_base.translation;
    if (ms == 3000) CHECK(last->y() == 0.0);
  }
  CHECK(poses == 800);
  CHECK(largest_step_m == Approx(0.4 * 0.005).epsilon(1e-6));
  CHECK(last->y() == Approx(0.4).margin(0.01));
  CHECK(stream.counts().jumps == 0);
}

TEST_CASE("a correction above the threshold is flagged as a jump and applied to the next pose",
          "[imu_pose_stream]") {
  ImuPoseStream stream({});
  stream.add(scan_record(0, 0));
  REQUIRE(stream.add(sample_record(5)).has_value());
  const ImuPoseUpdate update = stream.add(scan_record(1, 2, 1.5));
  CHECK(update.correction.jumped);
  CHECK(update.correction.distance_m == Approx(1.5));
  CHECK(stream.counts().jumps == 1);
  CHECK(stream.add(sample_record(10))->T_odom_base.translation.y() == 1.5);
}

TEST_CASE("a residual correction increases the covariance", "[imu_pose_stream]") {
  ImuPoseStream stream({});
  stream.add(scan_record(0, 0));
  const auto plain = stream.add(sample_record(5));
  CHECK(plain->pose_covariance[7] == Approx(1e-4 + 1e-2 * 0.005 * 0.005));
  stream.add(scan_record(1, 5, 0.3));
  const auto corrected = stream.add(sample_record(6));
  CHECK(corrected->pose_covariance[7] == Approx(0.3 * 0.3).epsilon(0.02));
  CHECK(corrected->twist_covariance == plain->twist_covariance);
}

TEST_CASE("thinning keeps the rate with irregular samples and counts the skipped ones", "[imu_pose_stream]") {
  ImuPoseConfig config;
  config.max_rate_hz = 100.0;
  ImuPoseStream stream(config);
  stream.add(scan_record(0, 0));
  std::optional<Time> last;
  std::vector<std::int64_t> steps;
  for (std::int64_t i = 1; i <= 1000; ++i) {  // 400 Hz with jitter of up to 1 ms
    ImuRecord record = sample_record(0);
    record.sample.stamp = record.sample.stamp + Duration{i * 2'500'000 + (i * 7919 % 2'000'000 - 1'000'000)};
    const auto pose = stream.add(record);
    if (!pose) continue;
    if (last) steps.push_back((pose->stamp - *last).ns);
    last = pose->stamp;
  }
  const ImuPoseCounts counts = stream.counts();
  CHECK(counts.published + counts.thinned == 1000);
  CHECK(counts.published >= 245);
  CHECK(counts.published <= 251);
}

TEST_CASE("samples that a time shift moves before the last published pose are withheld",
          "[imu_pose_stream]") {
  ImuPoseStream stream({});
  stream.add(scan_record(0, 0));
  REQUIRE(stream.add(sample_record(50)).has_value());
  PoseRecord shifted = scan_record(1, 20);
  shifted.imu_time_shift_ns = 8 * kMs;
  stream.add(shifted);
  CHECK_FALSE(stream.add(sample_record(55)).has_value());
  const auto next = stream.add(sample_record(60));
  REQUIRE(next.has_value());
  CHECK(next->stamp.ns == kStartNs + 52 * kMs);
  CHECK(stream.counts().withheld == 1);
}

TEST_CASE("clocks set back by hours are followed from the second scan on", "[imu_pose_stream]") {
  ImuPoseStream stream({});
  stream.add(scan_record(0, 10'000'000));
  REQUIRE(stream.add(sample_record(10'000'005)).has_value());
  stream.add(scan_record(1, 0));
  CHECK_FALSE(stream.add(sample_record(5)).has_value());
  stream.add(scan_record(2, 6));
  const auto pose = stream.add(sample_record(10));
  REQUIRE(pose.has_value());
  CHECK(pose->stamp.ns == kStartNs + 10 * kMs);
  CHECK(stream.add(sample_record(15)).has_value());
}

TEST_CASE("poses and samples are taken in the order of their arrival", "[imu_pose_stream]") {
  PoseRecord pose;
  pose.stage_ns[static_cast<std::size_t>(Stage::kDelivered)] = 5 * kMs;
  CHECK(pose_comes_first(pose, sample_record(6)));
  CHECK_FALSE(pose_comes_first(pose, sample_record(4)));
}
