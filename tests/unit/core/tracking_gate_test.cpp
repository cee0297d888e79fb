#include "core/src/recovery/tracking_gate.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <random>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

constexpr double kPeriodS = 0.1;

/// A gate and the motion of scans that arrive every 0.1 s, at rest.
struct Drive {
  OdometryConfig config;
  MotionEstimator motion{config};
  TrackingGate gate{config, info_of(RegistrationMethod::kNdtIcp)};
  int scans = 0;

  Drive() {
    start();
    for (std::uint64_t i = 1; i <= kInitialScans; ++i) accept(good());
  }
  void start() {
    motion.start(next_scan());
    gate.begin_map(1.5);
    motion.place_first_sweep(motion.prior().span);
    motion.finish(0);
  }
  Scan next_scan() {
    Scan scan;
    scan.start = Time::from_seconds(kPeriodS * scans++);
    scan.end = scan.start + Duration::from_seconds(kPeriodS);
    return scan;
  }
  /// An alignment at the predicted pose that agrees with the map.
  [[nodiscard]] static Alignment good(double agreement = 0.8) {
    Alignment result;
    result.points = 1000;
    result.known_share = 1.0;
    result.registration.stop_reason = StopReason::kConverged;
    result.registration.iterations = 3;
    result.registration.equations.agreement = 1000.0 * agreement;
    result.registration.information = 1e6 * Matrix6::Identity();
    return result;
  }
  TrackingState accept(Alignment alignment) {
    motion.predict(next_scan());
    alignment.registration.T_map_moving = motion.T_predicted();
    REQUIRE(gate.accepts(alignment, motion));
    const TrackingState state = gate.accept(alignment, motion);
    motion.update(alignment.registration);
    motion.finish(alignment.registration.degenerate_axes);
    return state;
  }
  TrackingState fail(bool for_lack_of_time = false) {
    motion.predict(next_scan());
    const TrackingState state = gate.fail(good(), motion, for_lack_of_time);
    motion.coast();
    motion.finish(0);
    return state;
  }
};

}  // namespace

TEST_CASE("the fifth predicted pose in a row is lost, and a registration ends that", "[tracking_gate]") {
  Drive drive;
  for (int i = 0; i < 4; ++i) CHECK(drive.fail() == TrackingState::kDegraded);
  CHECK(drive.fail() == TrackingState::kLost);
  CHECK(drive.gate.last_failed());
  CHECK_FALSE(drive.gate.vouches());
  CHECK(drive.accept(Drive::good()) == TrackingState::kTracking);
  CHECK(drive.gate.vouches());
}

TEST_CASE("a prediction over seconds without a sensor is lost at once, for lack of time as well",
          "[tracking_gate]") {
  for (const bool for_lack_of_time : {false, true}) {
    Drive drive;
    drive.scans += 130;
    CHECK(drive.fail(for_lack_of_time) == TrackingState::kLost);
  }
  Drive drive;
  drive.scans += 2;
  CHECK(drive.fail() == TrackingState::kDegraded);
}

TEST_CASE("a scan for which there was no time is no reason to recover", "[tracking_gate]") {
  Drive drive;
  drive.fail(true);
  CHECK_FALSE(drive.gate.last_failed());
}

TEST_CASE("agreement out of family is degraded, and the eighth in a row is lost", "[tracking_gate]") {
  Drive drive;
  const Alignment doubtful = Drive::good(0.5);
  for (int i = 0; i < 7; ++i) CHECK(drive.accept(doubtful) == TrackingState::kDegraded);
  CHECK(drive.accept(doubtful) == TrackingState::kLost);
  CHECK_FALSE(drive.gate.vouches());
}

TEST_CASE("a direction that the scan does not show degrades the pose, but not that of a vehicle out of doubt",
          "[tracking_gate]") {
  Drive drive;
  Alignment alignment = Drive::good();
  alignment.registration.degenerate_axes = 1;
  CHECK(drive.accept(alignment) == TrackingState::kDegraded);
  CHECK(drive.gate.vouches());
  CHECK_FALSE(drive.motion.prior_for(drive.next_scan()).inputs.speed_is_observed);
}

TEST_CASE("a pose that NDT alone found is degraded", "[tracking_gate]") {
  Drive drive;
  Alignment alignment = Drive::good();
  alignment.only_ndt = true;
  CHECK(drive.accept(alignment) == TrackingState::kDegraded);
  CHECK(drive.gate.vouches());
  CHECK(drive.accept(Drive::good()) == TrackingState::kTracking);
}

TEST_CASE("points that no voxel knows agree with nothing", "[tracking_gate]") {
  Drive drive;
  drive.motion.predict(drive.next_scan());
  Alignment alignment = Drive::good();
  CHECK(drive.gate.agreement(alignment, drive.motion) == Approx(0.8));
  alignment.known_share = 0.5;
  CHECK(drive.gate.agreement(alignment, drive.motion) == Approx(0.8));
  alignment.known_share = 0.25;
  CHECK(drive.gate.agreement(alignment, drive.motion) == Approx(0.4));
  alignment.registration.stop_reason = StopReason::kTooFewPoints;
  CHECK(drive.gate.agreement(alignment, drive.motion) == 0.0);
}

TEST_CASE("NDT runs at the beginning, after a failure, and for 20 scans after a direction was not seen",
          "[tracking_gate]") {
  Drive drive;
  for (int i = 0; i < 20; ++i) drive.accept(Drive::good());
  CHECK_FALSE(drive.gate.coarse_is_due(drive.motion));
  drive.fail();
  CHECK(drive.gate.coarse_is_due(drive.motion));
  for (int i = 0; i < 2; ++i) drive.accept(Drive::good());
  CHECK_FALSE(drive.gate.coarse_is_due(drive.motion));
  Drive beginning;
  beginning.gate.begin_map(1.5);
  Alignment blind = Drive::good();
  blind.registration.degenerate_axes = 2;
  beginning.accept(blind);
  for (int i = 0; i < 20; ++i) {
    CHECK(beginning.gate.coarse_is_due(beginning.motion));
    beginning.accept(Drive::good());
  }
  CHECK_FALSE(beginning.gate.coarse_is_due(beginning.motion));
}

TEST_CASE("a map is reset after 30 predicted poses or ten searches in vain", "[tracking_gate]") {
  Drive drive;
  for (int i = 0; i < 29; ++i) drive.fail();
  CHECK_FALSE(drive.gate.restart_is_due(drive.motion));
  drive.fail();
  CHECK(drive.gate.restart_is_due(drive.motion));
  drive.gate.begin_map(1.5);
  CHECK_FALSE(drive.gate.restart_is_due(drive.motion));
  for (int i = 0; i < 10; ++i) drive.gate.count_search();
  CHECK(drive.gate.restart_is_due(drive.motion));
}

TEST_CASE("few points may agree better by chance, many may not", "[tracking_gate]") {
  CHECK(chance_of_agreement({}) == 0.0);
  std::mt19937_64 generator(3);
  for (const std::size_t points : {30U, 2000U}) {
    std::bernoulli_distribution agrees(0.7);
    int beyond = 0;
    double widest = 0.0;
    for (int draw = 0; draw < 2000; ++draw) {
      Alignment alignment = Drive::good();
      alignment.points = points;
      alignment.registration.equations.agreement = 0.0;
      for (std::size_t i = 0; i < points; ++i)
        alignment.registration.equations.agreement += agrees(generator) ? 1.0 : 0.0;
      const double chance = chance_of_agreement(alignment);
      const double mean = alignment.agreement() / static_cast<double>(points);
      beyond += std::abs(mean - 0.7) > chance ? 1 : 0;
      widest = std::max(widest, chance);
    }
    INFO(points << " points");
    CHECK(beyond < 40);
    CHECK(widest < 1.5 / std::sqrt(static_cast<double>(points)) + 1e-9);
  }
}

TEST_CASE(
    "behind a gap in a place that the map does not know it is reset, and tracking is said a second later",
    "[tracking_gate]") {
  Alignment unknown = Drive::good();
  unknown.known_share = 0.2;
  Drive drive;
  drive.scans += 1;
  drive.accept(unknown);
  // Over one missing scan the prediction tells the place.
  CHECK_FALSE(drive.gate.restart_is_due(drive.motion));
  drive.accept(Drive::good());
  drive.scans += 25;
  CHECK(drive.accept(unknown) == TrackingState::kDegraded);
  REQUIRE(drive.gate.restart_is_due(drive.motion));
  drive.motion.leave_map();
  CHECK(drive.motion.motion_goes_on());
  drive.start();
  CHECK_FALSE(drive.gate.restart_is_due(drive.motion));
  // The motion goes on unless the second scan agrees less with the new map than scans did with the old one.
  CHECK(drive.gate.begins_in_family(Drive::good(0.7), drive.motion));
  CHECK_FALSE(drive.gate.begins_in_family(Drive::good(0.5), drive.motion));
  Alignment few = Drive::good(0.5);
  few.points = 40;
  few.registration.equations.agreement = 20.0;
  CHECK(drive.gate.begins_in_family(few, drive.motion));
  for (int i = 1; i < 5; ++i) CHECK(drive.accept(Drive::good()) == TrackingState::kInitialising);
  for (int i = 5; i < 10; ++i) CHECK(drive.accept(Drive::good()) == TrackingState::kDegraded);
  CHECK(drive.accept(Drive::good()) == TrackingState::kTracking);

  Drive known;
  known.scans += 25;
  known.accept(Drive::good(0.5));
  CHECK_FALSE(known.gate.restart_is_due(known.motion));
}

TEST_CASE("a pose to which no vehicle can have driven is lost, and so are those of a second after it",
          "[tracking_gate]") {
  Drive drive;
  const auto at = [](double x, double t, double since) {
    return PublishedPose{{Eigen::Quaterniond::Identity(), Vector3(x, 0.0, 0.0)},
                         Time::from_seconds(t),
                         since,
                         10.0,
                         Matrix6::Zero()};
  };
  const auto state_of = [&](const PublishedPose& pose) {
    return drive.gate.published_state(pose, TrackingState::kTracking);
  };
  drive.gate.publish(at(0.0, 1.0, 0.1), TrackingState::kTracking);
  CHECK(state_of(at(1.0, 1.1, 0.1)) == TrackingState::kTracking);
  // 10 m/s and 5 m/s more within 0.1 s.
  CHECK(state_of(at(1.5, 1.1, 0.1)) == TrackingState::kTracking);
  CHECK(state_of(at(1.6, 1.1, 0.1)) == TrackingState::kLost);
  CHECK(drive.gate.published_state(at(1.6, 1.1, 0.1), TrackingState::kInitialising) ==
        TrackingState::kInitialising);
  drive.gate.publish(at(5.0, 1.1, 0.1), TrackingState::kLost);
  CHECK(state_of(at(6.0, 2.0, 0.1)) == TrackingState::kLost);
  CHECK(state_of(at(6.0, 2.2, 0.1)) == TrackingState::kTracking);
}

TEST_CASE(
    "a pose that is not known to 0.1 m and 2 % or 1 degree is degraded, as are those of a second after it",
    "[tracking_gate]") {
  Drive drive;
  const auto at = [](double t, double speed, double metres, double degrees = 0.0) {
    PublishedPose pose{{}, Time::from_seconds(t), 0.1, speed, Matrix6::Zero()};
    pose.covariance(1, 1) = metres * metres;
    pose.covariance(5, 5) = std::pow(degrees * nilio::kRadiansPerDegree, 2);
    return pose;
  };
  const auto state_of = [&](const PublishedPose& pose) {
    return drive.gate.published_state(pose, TrackingState::kTracking);
  };
  // Three deviations of the difference of two poses: 3 sqrt(2) 0.0236 m = 0.1 m.
  CHECK(state_of(at(1.0, 0.0, 0.023)) == TrackingState::kTracking);
  CHECK(state_of(at(1.0, 0.0, 0.024)) == TrackingState::kDegraded);
  CHECK(state_of(at(1.0, 10.0, 0.070)) == TrackingState::kTracking);
  CHECK(state_of(at(1.0, 10.0, 0.071)) == TrackingState::kDegraded);
  CHECK(state_of(at(1.0, 0.0, 0.0, 0.23)) == TrackingState::kTracking);
  CHECK(state_of(at(1.0, 0.0, 0.0, 0.24)) == TrackingState::kDegraded);
  CHECK(drive.gate.published_state(at(1.0, 0.0, 1.0), TrackingState::kLost) == TrackingState::kLost);
  drive.gate.publish(at(1.0, 0.0, 1.0), TrackingState::kInitialising);
  CHECK(state_of(at(1.1, 0.0, 0.01)) == TrackingState::kTracking);
  drive.gate.publish(at(1.1, 0.0, 1.0), TrackingState::kDegraded);
  CHECK(state_of(at(2.0, 0.0, 0.01)) == TrackingState::kDegraded);
  CHECK(state_of(at(2.2, 0.0, 0.01)) == TrackingState::kTracking);
}

TEST_CASE("a relocalised pose must be a local optimum", "[tracking_gate]") {
  Drive drive;
  drive.motion.predict(drive.next_scan());
  Alignment alignment = Drive::good();
  alignment.registration.stop_reason = StopReason::kMaxIterations;
  CHECK(is_plausible(alignment, drive.motion));
  alignment.relocalized = true;
  CHECK_FALSE(is_plausible(alignment, drive.motion));
}
