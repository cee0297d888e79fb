#include "core/src/recovery/initial_motions.hpp"

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

/// An alignment of so many points, of which a share agrees, at this place ahead.
Alignment alignment_at(double x, std::size_t points, double mean_agreement) {
  Alignment result;
  result.points = points;
  result.registration.T_map_moving.translation.x() = x;
  result.registration.stop_reason = StopReason::kConverged;
  result.registration.iterations = 3;
  result.registration.equations.agreement = mean_agreement * static_cast<double>(points);
  result.registration.information = 1e4 * Matrix6::Identity();
  return result;
}

/// The motion of the second of two scans, 0.1 s apart, from this speed.
MotionEstimator::Hypothesis motion_with(double speed_m_s) {
  MotionEstimator motion{OdometryConfig{}};
  Scan scan;
  scan.end = Time::from_seconds(0.1);
  motion.start(scan);
  motion.place_first_sweep(motion.prior().span);
  motion.finish(0);
  scan.start = scan.end;
  scan.end = Time::from_seconds(0.2);
  motion.predict(scan);
  motion.set_last_twist(speed_m_s * Vector6::UnitX(), Vector6::Constant(1.0));
  motion.predict_again();
  return motion.hypothesis();
}

std::vector<double> places(InitialMotions& motions) {
  std::vector<double> result;
  for (const InitialMotion& motion : motions.motions())
    result.push_back(motion.alignment.pose().translation.x());
  return result;
}

InitialMotions begun() {
  InitialMotions motions(100);
  motions.begin(std::vector<SweepPoint>(10), {Time{}, Time::from_seconds(0.1)});
  return motions;
}

}  // namespace

TEST_CASE("a motion lives while no other agrees much better", "[initial_motions]") {
  InitialMotions motions = begun();
  motions.add(motion_with(30.0), alignment_at(3.0, 150, 0.62));
  motions.add(motion_with(10.0), alignment_at(1.0, 200, 0.8));
  motions.add(motion_with(40.0), alignment_at(4.0, 150, 0.58));
  motions.keep_likely();
  CHECK(places(motions) == std::vector<double>{1.0, 3.0});
  CHECK_FALSE(motions.are_decided());
}

TEST_CASE("from the third scan on the motion that shows the way best is taken, not that of most points",
          "[initial_motions]") {
  for (const bool shows_way : {true, false}) {
    CAPTURE(shows_way);
    InitialMotions motions = begun();
    // Vehicles that move along, on ground that agrees with every motion.
    motions.add(motion_with(20.0), alignment_at(2.0, 320, 0.77));
    Alignment true_one = alignment_at(0.0, 200, 0.8);
    true_one.registration.information(0, 0) = 4e4;
    if (!shows_way) true_one.registration.degenerate_axes = 1;
    motions.add(motion_with(0.0), true_one);
    motions.keep_likely();
    CHECK(places(motions) == std::vector<double>{2.0, 0.0});
    motions.end_scan(std::vector<SweepPoint>(10));
    motions.keep_likely();
    CHECK(places(motions) == (shows_way ? std::vector<double>{0.0, 2.0} : std::vector<double>{2.0, 0.0}));
  }
}

TEST_CASE("a motion that leaves less of the scene in view lives although fewer points agree better",
          "[initial_motions]") {
  InitialMotions motions = begun();
  motions.add(motion_with(10.0), alignment_at(1.0, 1000, 0.65));
  motions.add(motion_with(40.0), alignment_at(4.0, 560, 0.9));
  motions.keep_likely();
  CHECK(places(motions) == std::vector<double>{1.0, 4.0});
}

TEST_CASE("of motions to the same place one is followed, and at rest where several agree equally",
          "[initial_motions]") {
  InitialMotions motions = begun();
  motions.add(motion_with(0.0), alignment_at(0.0, 200, 0.7));
  motions.add(motion_with(20.0), alignment_at(2.0, 200, 0.7));
  motions.add(motion_with(10.0), alignment_at(1.95, 200, 0.69));
  motions.keep_likely();
  CHECK(places(motions) == std::vector<double>{0.0, 2.0});
}

TEST_CASE("what an IMU calls stationary is so unless a third more points agree with a motion",
          "[initial_motions]") {
  for (const bool refuted : {false, true}) {
    CAPTURE(refuted);
    InitialMotions motions = begun();
    motions.add(motion_with(0.0), alignment_at(0.0, 300, 0.5));
    motions.add(motion_with(10.0), alignment_at(1.0, 300, refuted ? 0.68 : 0.66));
    CHECK(motions.keep_stationary() != refuted);
    CHECK(places(motions) == std::vector<double>{refuted ? 1.0 : 0.0});
  }
}

TEST_CASE("each motion remembers where it saw the scans, and the fifth ends the beginning",
          "[initial_motions]") {
  InitialMotions motions = begun();
  motions.place_first({SweepMotion{}, SE3{Eigen::Quaterniond::Identity(), Vector3(0.5, 0.0, 0.0)}});
  motions.add(motion_with(10.0), alignment_at(1.0, 200, 0.7));
  motions.add(motion_with(30.0), alignment_at(3.0, 200, 0.7));
  for (std::size_t scan = 1; scan < kInitialScans; ++scan) {
    CHECK(motions.sweeps().size() == scan);
    motions.keep_likely();
    CHECK_FALSE(motions.are_decided());
    motions.end_scan(std::vector<SweepPoint>(10 + scan));
  }
  CHECK(motions.are_decided());
  REQUIRE(motions.sweeps().size() == kInitialSweeps);
  CHECK(motions.sweeps()[2].size() == 12);
  const InitialMotion& kept = motions.motions().front();
  CHECK(kept.earlier[0].T_map_middle.translation.x() == 0.5);
  CHECK(kept.earlier[1].T_map_middle.translation.x() == Approx(1.0).margin(0.05));
  // The sweep is deskewed with the velocity that its registration shows.
  CHECK(kept.earlier[1].motion.middle_twist().x() == Approx(10.0).margin(1.0));
}
