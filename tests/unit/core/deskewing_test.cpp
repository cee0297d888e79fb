#include "core/src/preprocessing/deskewing.hpp"

#include "core/src/estimation/imu_buffer.hpp"
#include "core/src/estimation/twist_filter.hpp"
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

TEST_CASE("deskewing moves every firing to the frame at the end of the scan", "[deskewing]") {
  // A curve at 15 m/s and 1 rad/s: constant twist, so the model is exact.
  Vector6 twist;
  twist << 15.0, 0.0, 0.0, 0.0, 0.0, 1.0;
  const auto T_world_base = [&](double t) { return se3_exp(twist * t); };
  const MotionModel::Span span{Time{0}, Time{0}, Time::from_seconds(0.1)};
  MotionModel motion;
  motion.set_constant_rotation(span, twist.tail<3>());
  motion.predict(Vector3(3.0, 0.0, 0.0));
  // Registration of a scan deskewed at 3 m/s finds its midpoint.
  const SE3 registered = T_world_base(0.05) * motion.T_middle_end();
  const Vector6 measured = motion.measure(registered, se3_exp(twist * 0.05), 0.1);
  CHECK((measured - twist).norm() < 1e-3);
  const SE3 T_end = motion.refine(registered, measured);
  CHECK((T_end.translation - T_world_base(0.1).translation).norm() < 1e-3);
  CHECK((motion.body_velocity() - Vector3(15.0, 0.0, 0.0)).norm() < 1e-3);

  std::vector<SweepPoint> points;
  std::vector<Vector3> truth;
  for (int i = 0; i < 1000; ++i) {
    const double t = 0.1 * i / 1000.0;
    const Vector3 world(20.0 * std::cos(i), 20.0 * std::sin(i), 0.01 * i);
    points.push_back({(T_world_base(t).inverse() * world).cast<float>(), static_cast<float>(t - 0.1)});
    truth.push_back(T_world_base(0.1).inverse() * world);
  }
  std::vector<Eigen::Vector3f> output;
  motion.deskew(points, output);
  double worst = 0.0;
  for (std::size_t i = 0; i < output.size(); ++i)
    worst = std::max(worst, (output[i].cast<double>() - truth[i]).norm());
  CHECK(worst < 1e-3);
}

TEST_CASE("the gyro's rotation inside the sweep is kept when registration corrects the pose", "[deskewing]") {
  // Rotation that swings back: no constant rate describes it.
  const auto T_world_base = [](double t) {
    return SE3{so3_exp({0.0, 0.0, 0.05 * std::sin(2.0 * M_PI * t / 0.1)}), Vector3(10.0 * t, 0.0, 0.0)};
  };
  const Vector3 bias(0.0, 0.0, 0.02);
  ImuBuffer buffer(1000);
  for (int i = -10; i < 40; ++i)
    REQUIRE(buffer.add(imu_sample(T_world_base, 0.005 * i, bias), Eigen::Quaterniond::Identity()));
  const MotionModel::Span span{Time{0}, Time{0}, Time::from_seconds(0.1)};
  MotionModel motion;
  motion.set_rotation_from_imu(span, buffer, bias);
  motion.predict(Vector3(10.0, 0.0, 0.0));
  // A previous pose that was wrong by a degree: the gyro's rotation inside the sweep is kept.
  SE3 registered = T_world_base(0.1);
  registered.rotation = registered.rotation * so3_exp({0.0, 0.0, 0.017});
  motion.refine(registered, motion.measure(registered, T_world_base(-0.05).inverse(), 0.1));
  std::vector<SweepPoint> points;
  std::vector<Vector3> truth;
  for (int i = 0; i < 100; ++i) {
    const double t = 0.001 * i;
    const Vector3 world(30.0, -20.0 + 0.4 * i, 1.0);
    points.push_back({(T_world_base(t).inverse() * world).cast<float>(), static_cast<float>(t - 0.1)});
    truth.push_back(T_world_base(0.1).inverse() * world);
  }
  std::vector<Eigen::Vector3f> output;
  motion.deskew(points, output);
  double worst = 0.0;
  for (std::size_t i = 0; i < output.size(); ++i)
    worst = std::max(worst, (output[i].cast<double>() - truth[i]).norm());
  // A constant rate would leave 0.05 rad * 35 m = 1.7 m.
  CHECK(worst < 0.06);
  CHECK((motion.body_velocity() - Vector3(10.0, 0.0, 0.0)).norm() < 0.05);
}

TEST_CASE("a scan of zero duration is not deskewed", "[deskewing]") {
  MotionModel motion;
  motion.set_constant_rotation({Time{0}, Time{100}, Time{100}}, Vector3::Zero());
  motion.predict(Vector3::Zero());
  motion.refine(SE3{}, motion.measure(SE3{}, SE3{}, 0.0));
  std::vector<Eigen::Vector3f> output;
  motion.deskew({{Eigen::Vector3f(1.0F, 2.0F, 3.0F), 0.0F}}, output);
  CHECK((output[0] - Eigen::Vector3f(1.0F, 2.0F, 3.0F)).norm() < 1e-6F);
}

TEST_CASE("roll and pitch rates have no trend, and over a gap neither trend nor sway is extrapolated",
          "[deskewing]") {
  TwistFilter filter;
  Vector6 twist = Vector6::Zero();
  const TwistStep step{0.1, {}, Vector3::Zero()};
  for (int i = 0; i < 20; ++i) {
    twist += Vector6::Constant(0.02);
    filter.update(twist, Vector6::Ones(), step);
  }
  const Vector6 soon = filter.predict(step) - filter.twist();
  CHECK(soon[0] > 0.01);
  CHECK(soon[5] > 0.01);
  CHECK(soon.segment<2>(3).norm() == 0.0);
  const Vector6 later = filter.predict({1.0, {}, Vector3::Zero()});
  CHECK(later[0] == filter.twist()[0]);
  CHECK(later[5] == filter.twist()[5]);
  CHECK(later.segment<2>(3).norm() < 0.3 * filter.twist().segment<2>(3).norm());
}

TEST_CASE("the first scan of a corner is deskewed with the measured rate, a noisy one with the mean rate",
          "[deskewing]") {
  TwistFilter filter;
  filter.reset(Vector6::Zero());
  const TwistStep step{0.1, {}, Vector3::Zero()};
  const Vector6 observed = Vector6::Ones();
  constexpr double kNoise = 0.002;
  for (int i = 0; i < 40; ++i)
    filter.update(Vector6::Constant(i % 2 == 0 ? kNoise : -kNoise), observed, step);
  const Vector6 noisy = filter.correct(Vector6::Constant(kNoise), observed, step);
  CHECK(std::abs(noisy[5]) < 0.6 * kNoise);
  Vector6 corner = Vector6::Zero();
  corner[5] = 0.5;
  CHECK(filter.correct(corner, observed, step)[5] > 0.8 * corner[5]);
}
