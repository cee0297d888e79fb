#include "core/src/estimation/motion_estimator.hpp"

#include "tests/support/synthetic_imu_drive.hpp"

#include <numbers>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

constexpr double kPeriodS = 0.1;

Scan scan_at(double start_s) {
  Scan scan;
  scan.start = Time::from_seconds(start_s);
  scan.end = Time::from_seconds(start_s + kPeriodS);
  return scan;
}

SE3 at(double x) { return {Eigen::Quaterniond::Identity(), Vector3(x, 0.0, 0.0)}; }

/// Registration of a scan that shows its pose well.
RegistrationResult registered(const SE3& T_map_middle) {
  RegistrationResult result;
  result.T_map_moving = T_map_middle;
  result.information = 1e6 * Matrix6::Identity();
  return result;
}

/// A vehicle along x at a constant speed, as its scans register it.
struct StraightDrive {
  MotionEstimator motion{OdometryConfig{}};
  double speed_m_s;
  int scans = 0;

  explicit StraightDrive(double speed) : speed_m_s(speed) {
    const Scan first = next();
    motion.start(first);
    motion.place_first_sweep(motion.prior().span);
    motion.finish(0);
  }
  Scan next() { return scan_at(kPeriodS * scans++); }
  /// Registers scans at their true poses.
  void drive(int count) {
    for (int i = 0; i < count; ++i) {
      motion.predict(next());
      const RegistrationResult registration = registered(at(speed_m_s * kPeriodS * (scans - 1)));
      motion.follow(registration);
      motion.update(registration);
      motion.finish(0);
    }
  }
};

}  // namespace

TEST_CASE("a constant motion is predicted, and its scans are deskewed by it", "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.drive(20);
  drive.motion.predict(drive.next());
  const double x = drive.motion.T_predicted().translation.x();
  CHECK(x == Approx(20.0 * kPeriodS * 21).margin(0.02));
  CHECK(drive.motion.motion().end_twist().x() == Approx(20.0).margin(0.2));
  CHECK(drive.motion.deviation_m() < 0.5);
  CHECK_FALSE(drive.motion.prior().is_gap);
  CHECK(drive.motion.period_s() == Approx(kPeriodS));
}

TEST_CASE("a host clock that is set ahead leaves the motion as it is, also over a gap",
          "[motion_estimator]") {
  for (const double step_s : {1.0, 3600.0}) {
    for (const int missing : {0, 5}) {
      INFO("by " << step_s << " s, " << missing << " scans are missing");
      StraightDrive drive(20.0);
      drive.drive(20);
      drive.scans += missing;
      Scan scan = scan_at(kPeriodS * drive.scans + step_s);
      scan.after_time_jump = true;
      scan.clock_step = Duration::from_seconds(step_s);
      CHECK(drive.motion.is_behind_gap(scan) == (missing > 0));
      drive.motion.predict(scan);
      CHECK(drive.motion.T_predicted().translation.x() ==
            Approx(20.0 * kPeriodS * (21 + missing)).margin(0.1));
      CHECK(drive.motion.prior().span_s() == Approx(kPeriodS * (1 + missing)).margin(1e-6));
      CHECK(drive.motion.prior().is_known_gap == (missing > 0));
    }
  }
}

TEST_CASE("a pose far from the prediction does not fit, and a manoeuvre makes room for it",
          "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.drive(20);
  drive.motion.predict(drive.next());
  const double expected = drive.motion.T_predicted().translation.x();
  CHECK(drive.motion.fits(registered(at(expected))));
  const RegistrationResult braked = registered(at(expected - 0.5));
  CHECK_FALSE(drive.motion.fits(braked));
  const double before = drive.motion.filter().pose_covariance()(0, 0);
  REQUIRE(drive.motion.widen_for_manoeuvre(braked.T_map_moving));
  CHECK(drive.motion.filter().pose_covariance()(0, 0) > 4.0 * before);
}

TEST_CASE("a scan that contradicts the velocity that was found makes it unknown again",
          "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.motion.predict(drive.next());
  Vector6 twist = Vector6::Zero();
  twist.x() = 20.0;
  drive.motion.set_last_twist(twist, Vector6::Constant(1e-4));
  drive.motion.predict_again();
  CHECK(drive.motion.T_predicted().translation.x() == Approx(2.0).margin(1e-3));
  CHECK(drive.motion.filter().twist_covariance()(0, 0) < 2.0);
  REQUIRE(drive.motion.widen_for_manoeuvre(at(3.5)));
  CHECK(drive.motion.filter().twist_covariance()(0, 0) > 100.0);
}

TEST_CASE("a hypothesis is returned to with its prediction", "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.drive(20);
  drive.motion.predict(drive.next());
  const SE3 predicted = drive.motion.T_predicted();
  const auto kept = drive.motion.hypothesis();
  drive.motion.predict_moving();
  CHECK((drive.motion.T_predicted().translation - predicted.translation).norm() > 1.0);
  drive.motion.return_to(kept);
  CHECK(drive.motion.T_predicted().translation == predicted.translation);
  CHECK(drive.motion.motion().end_twist().x() == Approx(20.0).margin(0.2));
}

TEST_CASE("without an IMU no motion goes on in a new map", "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.drive(20);
  drive.motion.leave_map();
  CHECK(drive.motion.scans() == 0);
  CHECK_FALSE(drive.motion.motion_goes_on());
  // The map begins where the vehicle was last.
  const double x = drive.motion.T_map_base().translation.x();
  drive.motion.start(drive.next());
  CHECK(drive.motion.T_map_base().translation.x() == x);
  CHECK(drive.motion.filter().state().velocity.norm() == 0.0);
}

TEST_CASE("behind a gap the motion goes on in a new map also without an IMU, and tyres say how far",
          "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.drive(20);
  drive.scans += 20;
  drive.motion.predict(drive.next());
  REQUIRE(drive.motion.prior().is_gap);
  const double x = drive.motion.T_predicted().translation.x();
  // 2.1 s at 10 m/s^2.
  CHECK(drive.motion.may_reach(at(x - 21.0)));
  CHECK_FALSE(drive.motion.may_reach(at(x - 23.0)));
  drive.motion.coast();
  drive.motion.finish(0);
  drive.motion.leave_map();
  CHECK(drive.motion.motion_goes_on());
  drive.motion.start(drive.next());
  CHECK(drive.motion.filter().state().velocity.x() == Approx(20.0).margin(0.5));
  CHECK(drive.motion.T_map_base().translation.x() == Approx(x + 3.0).margin(0.2));
}

TEST_CASE("a pose behind a gap may be anywhere if a clock was set meanwhile", "[motion_estimator]") {
  StraightDrive drive(20.0);
  drive.drive(20);
  drive.scans += 10;
  Scan scan = drive.next();
  scan.after_time_jump = true;
  drive.motion.predict(scan);
  CHECK(drive.motion.may_reach(at(drive.motion.T_predicted().translation.x() - 20.0)));
}

TEST_CASE("with an IMU that measured the motion it goes on in a new map", "[motion_estimator]") {
  const nilio::tests::SyntheticImuDrive truth;
  OdometryConfig config;
  config.T_base_imu = truth.T_base_imu;
  MotionEstimator motion(config);
  int samples = 0;
  const auto add_samples_until = [&](double t) {
    for (; 0.0025 * samples < t; ++samples) motion.add_imu(truth.sample(0.0025 * samples));
  };
  double x = 0.0;
  const auto pose = [&](double t) {
    SE3 result;
    constexpr double kStep = 1e-3;
    for (double s = 0.5 * kStep; s < t; s += kStep)
      result.translation += kStep * (truth.rotation(s) * Vector3(truth.speed(s), 0.0, 0.0));
    result.rotation = truth.rotation(t);
    return result;
  };
  // The map begins at the end of the first sweep.
  const SE3 T_first = pose(kPeriodS);
  add_samples_until(0.11);
  motion.start(scan_at(0.0));
  const SweepSpan first = motion.prior().span;
  motion.place_first_sweep(first);
  motion.finish(0);
  for (int i = 1; i < 60; ++i) {
    add_samples_until(kPeriodS * (i + 1) + 0.01);
    motion.predict(scan_at(kPeriodS * i));
    if (i == 1) {
      // As the search for the initial velocity does; an IMU without noise looks stationary.
      motion.end_stationary();
      Vector6 twist = Vector6::Zero();
      twist.x() = truth.speed(0.05);
      motion.set_last_twist(twist, Vector6::Constant(0.01));
      motion.place_first_sweep(first);
      motion.predict_again();
    }
    const RegistrationResult registration = registered(T_first.inverse() * pose(kPeriodS * (i + 0.5)));
    motion.follow(registration);
    motion.update(registration);
    motion.finish(0);
    x = motion.filter().state().velocity.x();
  }
  REQUIRE(motion.prior().inputs.measure_motion());
  motion.leave_map();
  REQUIRE(motion.motion_goes_on());
  add_samples_until(6.11);
  motion.start(scan_at(6.0));
  CHECK(motion.filter().state().velocity.x() == Approx(x).margin(0.5));
  CHECK(motion.filter().state().velocity.x() == Approx(truth.speed(6.05)).margin(0.3));
  // The second scan cannot be registered, and the map is reset again: the IMU still knows the motion.
  motion.place_first_sweep(motion.prior().span);
  motion.finish(0);
  add_samples_until(6.21);
  motion.predict(scan_at(6.1));
  motion.coast();
  motion.finish(0);
  REQUIRE(motion.is_initialising());
  motion.leave_map();
  CHECK(motion.motion_goes_on());
  add_samples_until(6.31);
  motion.start(scan_at(6.2));
  CHECK(motion.filter().state().velocity.x() == Approx(truth.speed(6.25)).margin(0.3));
  // A motion that a scan refuted is not known until one is found.
  motion.forget_motion();
  motion.leave_map();
  CHECK_FALSE(motion.motion_goes_on());
}

TEST_CASE("an IMU that senses a motion that scans do not show, as on a ship, is left out",
          "[motion_estimator]") {
  MotionEstimator motion{OdometryConfig{}};
  int samples = 0;
  const auto add_samples_until = [&](double t) {
    for (; 0.0025 * samples < t; ++samples) {
      const double s = 0.0025 * samples;
      const double noise = samples % 2 == 0 ? 0.02 : -0.02;
      // From 3 s on the ship rolls by 2 degrees within 11 s.
      const double omega = 2.0 * std::numbers::pi / 11.0;
      const double roll = s < 3.0 ? 0.0 : 0.035 * std::sin(omega * (s - 3.0));
      const double rate = s < 3.0 ? 0.0 : 0.035 * omega * std::cos(omega * (s - 3.0));
      motion.add_imu({Time::from_seconds(s),
                      {rate + 0.01 * noise, 0.0, 0.0},
                      {noise, 9.81 * std::sin(roll) - noise, 9.81 * std::cos(roll)}});
    }
  };
  bool was_used = false;
  int used_last = 0;
  for (int i = 0; i < 100; ++i) {
    add_samples_until(kPeriodS * (i + 1) + 0.01);
    if (i == 0) {
      motion.start(scan_at(0.0));
      motion.place_first_sweep(motion.prior().span);
    } else {
      motion.predict(scan_at(kPeriodS * i));
      const MotionFilter& filter = motion.filter();
      // The scan shows a vehicle at rest to 1 cm and 0.06 degrees; prior and scan together give the pose.
      const Matrix6 P = filter.pose_covariance();
      Matrix6 information = Matrix6::Zero();
      information.diagonal() << Vector3::Constant(1e4), Vector3::Constant(1e6);
      const Vector6 innovation = se3_log(filter.state().T_map_base.inverse());
      RegistrationResult registration =
          registered(filter.state().T_map_base *
                     se3_exp((P.inverse() + information).inverse() * information * innovation));
      registration.information = information;
      motion.follow(registration);
      motion.update(registration);
      was_used = was_used || motion.prior().inputs.measure_motion();
      if (motion.prior().inputs.gyro) used_last = i;
    }
    motion.finish(0);
  }
  CHECK(was_used);
  CHECK(used_last > 30);
  CHECK(used_last < 80);
  CHECK(motion.filter().state().T_map_base.translation.norm() < 0.1);
}
