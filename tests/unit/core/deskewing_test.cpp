#include "core/src/preprocessing/deskewing.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "tests/support/synthetic_room.hpp"

#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::imu_sample;

namespace {

ImuSample sample_at(double time_s, double rate_z) {
  return {Time::from_seconds(time_s), {0.0, 0.0, rate_z}, {0.0, 0.0, 9.81}};
}

}  // namespace

TEST_CASE("the IMU buffer refuses stamps that do not advance and values that are not finite", "[deskewing]") {
  ImuBuffer buffer(10);
  const Eigen::Quaterniond identity = Eigen::Quaterniond::Identity();
  CHECK(buffer.add(sample_at(1.0, 0.1), identity));
  CHECK_FALSE(buffer.add(sample_at(1.0, 0.1), identity));
  CHECK_FALSE(buffer.add(sample_at(0.9, 0.1), identity));
  CHECK_FALSE(buffer.add(sample_at(1.1, std::nan("")), identity));
  CHECK(buffer.size() == 1);
}

TEST_CASE("the IMU buffer keeps the newest samples and interpolates between them", "[deskewing]") {
  ImuBuffer buffer(4);
  for (int i = 0; i < 10; ++i) REQUIRE(buffer.add(sample_at(0.1 * i, i), Eigen::Quaterniond::Identity()));
  CHECK(buffer.size() == 4);
  CHECK(buffer[0].stamp == Time::from_seconds(0.6));
  CHECK(buffer.angular_velocity_at(Time::from_seconds(0.75)).z() == Approx(7.5));
  CHECK(buffer.angular_velocity_at(Time::from_seconds(0.1)).z() == Approx(6.0));
  CHECK(buffer.angular_velocity_at(Time::from_seconds(5.0)).z() == Approx(9.0));
}

TEST_CASE("coverage needs samples on both sides and no long gap in between", "[deskewing]") {
  ImuBuffer buffer(100);
  for (const double t : {0.0, 0.01, 0.02, 0.10, 0.11})
    REQUIRE(buffer.add(sample_at(t, 0.0), Eigen::Quaterniond::Identity()));
  const auto at = [](double s) { return Time::from_seconds(s); };
  CHECK(buffer.covers(at(0.005), at(0.015), Duration::from_seconds(0.05)));
  CHECK_FALSE(buffer.covers(at(0.005), at(0.105), Duration::from_seconds(0.05)));
  CHECK(buffer.covers(at(0.005), at(0.105), Duration::from_seconds(0.09)));
  CHECK_FALSE(buffer.covers(at(-0.01), at(0.02), Duration::from_seconds(0.09)));
  CHECK_FALSE(buffer.covers(at(0.0), at(0.12), Duration::from_seconds(0.09)));
}

namespace {

/// Points of a sweep of 0.1 s along `T_world_base`, as seen, and in the frame of base_link at its middle.
template <class Path>
double worst_deskewing(const SweepMotion& motion, const Path& T_world_base) {
  std::vector<SweepPoint> points;
  std::vector<Vector3> truth;
  for (int i = 0; i < 1000; ++i) {
    const double t = 0.1 * i / 1000.0;
    const Vector3 world(20.0 * std::cos(i), 20.0 * std::sin(i), 0.01 * i);
    points.push_back(
        {(T_world_base(t).inverse() * world).template cast<float>(), static_cast<float>(t - 0.1)});
    truth.push_back(T_world_base(0.05).inverse() * world);
  }
  std::vector<Eigen::Vector3f> output;
  motion.deskew(points, output);
  double worst = 0.0;
  for (std::size_t i = 0; i < output.size(); ++i)
    worst = std::max(worst, (output[i].cast<double>() - truth[i]).norm());
  return worst;
}

const SweepSpan kSweep{Time{0}, Time::from_seconds(0.1)};

}  // namespace

TEST_CASE("deskewing moves every firing to the frame at the middle of the sweep", "[deskewing]") {
  // A curve at 15 m/s and 1.5 rad/s: constant twist.
  Vector6 twist;
  twist << 15.0, 0.0, 0.0, 0.0, 0.0, 1.5;
  const auto T_world_base = [&](double t) { return se3_exp(twist * t); };
  MotionState state;
  state.time = kSweep.middle();
  state.T_map_base = T_world_base(0.05);
  state.velocity = twist.head<3>();
  state.angular_velocity = twist.tail<3>();
  const SweepMotion motion(kSweep, state, {});
  CHECK(worst_deskewing(motion, T_world_base) < 1e-3);
  const SE3 off = (T_world_base(0.05).inverse() * T_world_base(0.1)).inverse() * motion.T_middle_end();
  CHECK(off.translation.norm() < 1e-4);
  CHECK((motion.end_twist() - twist).norm() < 1e-9);
}

TEST_CASE("a rate that changes within the sweep is followed by its acceleration", "[deskewing]") {
  // Into a corner with 4 rad/s^2.
  const auto T_world_base = [](double t) {
    return SE3{so3_exp({0.0, 0.0, 2.0 * (t - 0.05) * (t - 0.05)}), Vector3::Zero()};
  };
  MotionState state;
  state.time = kSweep.middle();
  CHECK(worst_deskewing(SweepMotion(kSweep, state, {}), T_world_base) > 0.09);
  state.angular_acceleration.z() = 4.0;
  CHECK(worst_deskewing(SweepMotion(kSweep, state, {}), T_world_base) < 0.01);
}

TEST_CASE("a rotation that swings back within the sweep is that of the gyro", "[deskewing]") {
  const auto T_world_base = [](double t) {
    return SE3{so3_exp({0.0, 0.0, 0.05 * std::sin(2.0 * M_PI * t / 0.1)}), Vector3(10.0 * t, 0.0, 0.0)};
  };
  const Vector3 bias(0.0, 0.0, 0.02);
  ImuBuffer buffer(1000);
  for (int i = -10; i < 40; ++i)
    REQUIRE(buffer.add(imu_sample(T_world_base, 0.005 * i, bias), Eigen::Quaterniond::Identity()));
  MotionState state;
  state.time = kSweep.middle();
  state.T_map_base = T_world_base(0.05);
  state.velocity = state.T_map_base.rotation.conjugate() * Vector3(10.0, 0.0, 0.0);
  state.gyro_bias = bias;
  state.gravity = Vector3(0.0, 0.0, -9.81);
  MotionInputs inputs;
  inputs.imu = &buffer;
  inputs.gyro = inputs.accelerometer = true;
  // A constant rate would leave 0.05 rad * 20 m = 1 m.
  CHECK(worst_deskewing(SweepMotion(kSweep, state, inputs), T_world_base) < 0.06);
}

TEST_CASE("a scan of zero duration is not deskewed", "[deskewing]") {
  MotionState state;
  state.time = Time{100};
  const SweepMotion motion({Time{100}, Time{100}}, state, {});
  std::vector<Eigen::Vector3f> output;
  motion.deskew({{Eigen::Vector3f(1.0F, 2.0F, 3.0F), 0.0F}}, output);
  CHECK((output[0] - Eigen::Vector3f(1.0F, 2.0F, 3.0F)).norm() < 1e-6F);
}
