#include "nilio/core/odometry.hpp"

#include "nilio/core/odometry_runtime.hpp"

#include "tests/support/synthetic_room.hpp"

#include <algorithm>
#include <functional>
#include <limits>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <catch2/catch.hpp>

using namespace nilio::core;
using nilio::tests::imu_sample;
using nilio::tests::PoseFunction;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

constexpr double kPeriod = 0.1;

/// 8 m/s forward with a gentle S-curve; already moving at time 0.
SE3 driving(double t) {
  const double yaw = 0.15 * std::sin(0.8 * t);
  const double lateral = 8.0 * 0.15 / 0.8 * (1.0 - std::cos(0.8 * t));
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())), Vector3(8.0 * t, lateral, 0.0)};
}

/// After ten scans of the drive.
Odometry driven_odometry(const Room& room) {
  Odometry odometry(OdometryConfig{});
  for (int i = 0; i < 10; ++i)
    odometry.register_scan(scan_room(room, driving, i * kPeriod, static_cast<std::uint64_t>(i)));
  return odometry;
}

/// Bends one after the other.
SE3 winding_at(double t, double speed_m_s, double largest_yaw_rad) {
  const double yaw = largest_yaw_rad * std::sin(1.6 * t);
  const double lateral = speed_m_s * largest_yaw_rad / 1.6 * (1.0 - std::cos(1.6 * t));
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())), Vector3(speed_m_s * t, lateral, 0.0)};
}

/// As sharp as a town's: up to 23 deg/s.
SE3 winding(double t) { return winding_at(t, 8.0, 0.25); }

struct Run {
  std::vector<OdometryResult> results;
  double worst_error_m = 0.0;
  double end_error_m = 0.0;
};

struct RunSettings {
  int scans = 60;
  int threads = 1;
  bool imu = false;
  double imu_period_s = 0.005;
  Vector3 gyro_bias = Vector3(0.002, -0.001, 0.0035);
  std::function<void(int, Scan&)> damage;
};

Run run_odometry(const PoseFunction& T_world_base, const RunSettings& settings) {
  const Room room = Room::with_pillars();
  OdometryConfig config;
  config.threads = settings.threads;
  Odometry odometry(config);
  Run run;
  auto imu_index = static_cast<int>(-kPeriod / settings.imu_period_s);
  for (int i = 0; i < settings.scans; ++i) {
    const auto imu_time_s = [&] { return imu_index * settings.imu_period_s; };
    for (; settings.imu && imu_time_s() < (i + 1) * kPeriod + 0.01; ++imu_index)
      odometry.add_imu(imu_sample(T_world_base, imu_time_s(), settings.gyro_bias));
    Scan scan = scan_room(room, T_world_base, i * kPeriod, static_cast<std::uint64_t>(i));
    if (settings.damage) settings.damage(i, scan);
    run.results.push_back(odometry.register_scan(scan));
    const SE3 truth = T_world_base(kPeriod).inverse() * T_world_base((i + 1) * kPeriod);
    const SE3 estimate = run.results.front().T_odom_base.inverse() * run.results.back().T_odom_base;
    run.end_error_m = (truth.translation - estimate.translation).norm();
    run.worst_error_m = std::max(run.worst_error_m, run.end_error_m);
  }
  return run;
}

/// Ground between two rows of posts, with these gaps.
Room road_with_posts(double half_length_m, double half_width_m, std::uniform_real_distribution<double> gap_m,
                     std::mt19937_64& random) {
  Room road;
  road.low = {-1e3, -1e3, -1.8};
  road.high = {1e3, 1e3, 1e3};
  for (const double y : {-half_width_m, half_width_m}) {
    for (double x = -half_length_m; x < half_length_m; x += gap_m(random))
      road.pillars.push_back({x, y, 0.3});
  }
  return road;
}

/// Speed that the scans of the initialisation find for a vehicle that drives straight on at `speed_m_s`,
/// without an IMU, beside others that begin at these places and drive at `others_m_s`.
double initial_speed(const Room& road, double speed_m_s, double others_m_s,
                     const std::vector<Eigen::Vector2d>& others, std::uint64_t seed) {
  const auto straight = [&](double t) {
    return SE3{Eigen::Quaterniond::Identity(), Vector3(speed_m_s * t, 0.0, 0.0)};
  };
  Odometry odometry(OdometryConfig{});
  OdometryResult result;
  for (int i = 0; i < 5; ++i) {
    Room with_others = road;
    for (const Eigen::Vector2d& place : others)
      with_others.pillars.push_back({place.x() + others_m_s * i * kPeriod, place.y(), 0.9});
    result = odometry.register_scan(
        scan_room(with_others, straight, i * kPeriod, 5 * seed + static_cast<std::uint64_t>(i)));
  }
  return result.twist[0];
}

}  // namespace

TEST_CASE("a vehicle that already moves is tracked from its second scan on, without an IMU", "[odometry]") {
  const Run run = run_odometry(driving, {});
  CHECK(run.worst_error_m < 0.45);
  CHECK(run.results[1].twist[0] == Approx(8.0).margin(0.3));
  CHECK(run.results.front().state == TrackingState::kInitialising);
  CHECK(run.results.back().state == TrackingState::kTracking);
  CHECK_FALSE(run.results.back().imu_used);
}

TEST_CASE("with an IMU the rotation is predicted, its bias is estimated and the drift is small",
          "[odometry]") {
  RunSettings settings;
  settings.imu = true;
  const Run run = run_odometry(winding, settings);
  CHECK(run.worst_error_m < 0.45);
  CHECK(run.results.back().imu_used);
}

TEST_CASE("the pose in the middle of a sweep is the true motion before the pose of its end", "[odometry]") {
  for (const bool imu : {false, true}) {
    RunSettings settings;
    settings.imu = imu;
    const Run run = run_odometry(winding, settings);
    CHECK(run.results.front().T_odom_base_middle.translation == run.results.front().T_odom_base.translation);
    for (std::size_t i = 5; i < run.results.size(); ++i) {
      const double end_s = (static_cast<double>(i) + 1.0) * kPeriod;
      const SE3 truth = winding(end_s - 0.5 * kPeriod).inverse() * winding(end_s);
      const SE3 estimate = run.results[i].T_odom_base_middle.inverse() * run.results[i].T_odom_base;
      CHECK((truth.translation - estimate.translation).norm() < 0.05);
      CHECK(truth.rotation.angularDistance(estimate.rotation) < 0.01);
    }
  }
}

TEST_CASE("a stationary vehicle keeps its pose", "[odometry]") {
  const Run run = run_odometry([](double) { return SE3{}; }, {});
  CHECK(run.worst_error_m < 0.02);
  CHECK(run.results.back().twist.norm() < 0.2);
}

TEST_CASE("noise is rarely taken for a motion where no scan shows one, without an IMU", "[odometry]") {
  Room corridor;
  corridor.low.x() = -1e3;
  corridor.high.x() = 1e3;
  const auto at_rest = [](double) { return SE3{}; };
  int moving = 0;
  for (std::uint64_t seed = 0; seed < 60; ++seed) {
    Odometry odometry(OdometryConfig{});
    odometry.register_scan(scan_room(corridor, at_rest, 0.0, 2 * seed));
    const OdometryResult second = odometry.register_scan(scan_room(corridor, at_rest, kPeriod, 2 * seed + 1));
    moving += std::abs(second.twist[0]) > 1.0 ? 1 : 0;
  }
  CHECK(moving < 12);
}

TEST_CASE("the speed of a fast vehicle is mostly found at its second scan, between few posts, without an IMU",
          "[odometry]") {
  const auto fast = [](double t) { return SE3{Eigen::Quaterniond::Identity(), Vector3(30.0 * t, 0.0, 0.0)}; };
  int found = 0;
  for (std::uint64_t seed = 0; seed < 30; ++seed) {
    std::mt19937_64 random(seed);
    const Room plain =
        road_with_posts(100.0, 7.0, std::uniform_real_distribution<double>(12.0, 35.0), random);
    Odometry odometry(OdometryConfig{});
    odometry.register_scan(scan_room(plain, fast, 0.0, 2 * seed));
    const OdometryResult second = odometry.register_scan(scan_room(plain, fast, kPeriod, 2 * seed + 1));
    found += std::abs(second.twist[0] - 30.0) < 1.0 ? 1 : 0;
  }
  CHECK(found > 20);
}

TEST_CASE("the first scans find the speed of a vehicle that drives along with others, without an IMU",
          "[odometry]") {
  int found = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> speed_m_s(5.0, 45.0);
    std::uniform_real_distribution<double> slower_m_s(0.0, 3.0);
    const double speed = speed_m_s(random);
    const double others = speed - slower_m_s(random);
    const Room road = road_with_posts(150.0, 9.0, std::uniform_real_distribution<double>(5.0, 15.0), random);
    found +=
        std::abs(initial_speed(road, speed, others, {{-25, 3.5}, {18, 3.5}, {45, 3.5}}, seed) - speed) < 1.0;
  }
  CAPTURE(found);
  CHECK(found >= 18);
}

TEST_CASE("the first scans mostly find that a vehicle is stationary among moving objects, without an IMU",
          "[odometry]") {
  int found = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    std::mt19937_64 random(seed);
    std::uniform_real_distribution<double> others_m_s(2.0, 6.0);
    const double others = others_m_s(random);
    const Room road = road_with_posts(150.0, 12.0, std::uniform_real_distribution<double>(5.0, 15.0), random);
    const std::vector<Eigen::Vector2d> places = {{-14, 3.5},  {-7, 3.5},  {-1, 3.5}, {6, 3.5},  {13, 3.5},
                                                 {-11, -3.5}, {-4, -3.5}, {3, -3.5}, {10, -3.5}};
    found += std::abs(initial_speed(road, 0.0, others, places, seed)) < 0.3;
  }
  CAPTURE(found);
  CHECK(found >= 12);
}

TEST_CASE("a gyro is used only where its samples follow the body's sway", "[odometry]") {
  // Sway as of a recorded car, 0.8 deg/s of roll at 2 Hz.
  const auto swaying = [](double t) {
    return driving(t) * SE3{so3_exp(0.0011 * std::sin(12.6 * t) * Vector3::UnitX()), Vector3::Zero()};
  };
  RunSettings settings;
  settings.scans = 30;
  settings.imu = true;
  for (const double period_s : {0.01, 0.04, 0.1}) {
    settings.imu_period_s = period_s;
    const Run run = run_odometry(swaying, settings);
    CAPTURE(period_s);
    CHECK(run.results.back().imu_used == (period_s < 0.06));
    CHECK(run.worst_error_m < 0.1);
  }
}

TEST_CASE("the result is the same to the last bit with 1, 2 and 4 threads and in a second run",
          "[odometry]") {
  RunSettings settings;
  settings.scans = 15;
  settings.imu = true;
  const Run reference = run_odometry(driving, settings);
  for (const int threads : {1, 2, 4}) {
    settings.threads = threads;
    const Run run = run_odometry(driving, settings);
    for (std::size_t i = 0; i < run.results.size(); ++i) {
      CHECK(run.results[i].T_odom_base.translation == reference.results[i].T_odom_base.translation);
      CHECK(run.results[i].T_odom_base.rotation.coeffs() ==
            reference.results[i].T_odom_base.rotation.coeffs());
      CHECK(run.results[i].pose_covariance == reference.results[i].pose_covariance);
    }
  }
}

TEST_CASE("an empty or corrupt scan gets the predicted pose, is marked so, and tracking goes on",
          "[odometry]") {
  RunSettings settings;
  settings.imu = true;
  settings.damage = [](int i, Scan& scan) {
    if (i == 20) scan.points.clear();
    if (i == 30) {
      for (Point& point : scan.points) point.x = std::numeric_limits<float>::quiet_NaN();
    }
  };
  const Run run = run_odometry(driving, settings);
  for (const std::size_t i : {20U, 30U}) {
    CHECK(run.results[i].predicted);
    CHECK(run.results[i].state == TrackingState::kDegraded);
    CHECK(run.results[i].stop_reason == StopReason::kTooFewPoints);
    // The IMU bridges one scan.
    CHECK(run.results[i].pose_covariance(0, 0) > 1.2 * run.results[i - 1].pose_covariance(0, 0));
    CHECK_FALSE(run.results[i + 1].predicted);
  }
  CHECK(run.worst_error_m < 0.45);
}

TEST_CASE("a stream of empty scans is reported as lost and never crashes", "[odometry]") {
  RunSettings settings;
  settings.scans = 12;
  settings.damage = [](int, Scan& scan) { scan.points.clear(); };
  const Run run = run_odometry(driving, settings);
  CHECK(run.results.back().state == TrackingState::kLost);
  CHECK(run.results.back().T_odom_base.is_finite());
}

TEST_CASE("missing scans do not lose the track", "[odometry]") {
  const Room room = Room::with_pillars();
  Odometry odometry(OdometryConfig{});
  SE3 first;
  SE3 last;
  for (int i = -20; i < 1300; ++i) odometry.add_imu(imu_sample(driving, i * 0.005, Vector3::Zero()));
  for (int i = 0; i < 60; ++i) {
    if (i > 20 && i < 24) continue;
    const OdometryResult result =
        odometry.register_scan(scan_room(room, driving, i * kPeriod, static_cast<std::uint64_t>(i)));
    if (i == 0) first = result.T_odom_base;
    last = result.T_odom_base;
    if (i == 24) CHECK(result.coarse_iterations > 0);
  }
  const SE3 truth = driving(kPeriod).inverse() * driving(6.0);
  CHECK((truth.translation - (first.inverse() * last).translation).norm() < 0.45);
}

TEST_CASE("behind a gap, in a place that the map does not know, the pose is where the IMU says",
          "[odometry]") {
  const Room room = Room::with_pillars();
  OdometryConfig config;
  // Two seconds at 8 m/s lead to where hardly a point was seen before.
  config.max_range_m = 25.0F;
  Odometry odometry(config);
  std::vector<SE3> poses;
  int imu_index = -20;
  for (int i = 0; i < 80; ++i) {
    for (; imu_index * 0.005 < (i + 1) * kPeriod + 0.01; ++imu_index)
      odometry.add_imu(imu_sample(winding, imu_index * 0.005, Vector3::Zero()));
    if (i > 40 && i < 60) continue;
    const OdometryResult result =
        odometry.register_scan(scan_room(room, winding, i * kPeriod, static_cast<std::uint64_t>(i)));
    if (i >= 60) CHECK(result.imu_used);
    if (i >= 62) CHECK(result.state == TrackingState::kTracking);
    poses.push_back(result.T_odom_base);
  }
  const SE3 truth = winding(4.1).inverse() * winding(8.0);
  CHECK((truth.translation - (poses[40].inverse() * poses.back()).translation).norm() < 0.3);
}

TEST_CASE("the covariance covers the error of a tracked pose and is symmetric and positive", "[odometry]") {
  const Run run = run_odometry(driving, {});
  // Error of the motion since the map here was new; the attitude of the first scans does not count.
  const std::size_t last = run.results.size() - 1;
  const std::size_t since = last - 10;
  const SE3 truth = driving(kPeriod * static_cast<double>(since + 1)).inverse() *
                    driving(kPeriod * static_cast<double>(last + 1));
  const SE3 estimate = run.results[since].T_odom_base.inverse() * run.results[last].T_odom_base;
  const double error_m = (truth.translation - estimate.translation).norm();
  const Matrix6& covariance = run.results.back().pose_covariance;
  CHECK((covariance - covariance.transpose()).norm() < 1e-15);
  CHECK(covariance.ldlt().isPositive());
  CHECK(error_m < 3.0 * std::sqrt(covariance.topLeftCorner<3, 3>().trace()));
}

TEST_CASE("the drift covariance contains that against the map, and grows while the map is new",
          "[odometry]") {
  const Run run = run_odometry(driving, {});
  double before = 0.0;
  for (std::size_t i = 5; i < run.results.size(); ++i) {
    const Matrix6 drift = run.results[i].drift_covariance - run.results[i].pose_covariance;
    CHECK((drift - drift.transpose()).norm() < 1e-12);
    CHECK(drift.topLeftCorner<3, 3>().trace() > 0.999 * before);
    before = drift.topLeftCorner<3, 3>().trace();
  }
  CHECK(before > 0.0);
  CHECK(run.end_error_m < 3.0 * std::sqrt(run.results.back().drift_covariance.topLeftCorner<3, 3>().trace()));
}

TEST_CASE("a vehicle turned and moved without scans is reported as lost and relocalised", "[odometry]") {
  // 14 deg and 2 m from the prediction.
  const PoseFunction moved = [](double t) {
    const SE3 jump{Eigen::Quaterniond(Eigen::AngleAxisd(0.25, Vector3::UnitZ())), Vector3(2.0, 0.5, 0.0)};
    return t < 3.0 ? driving(1.0) : driving(1.0) * jump;
  };
  RunSettings settings;
  settings.damage = [](int i, Scan& scan) {
    if (i >= 24 && i < 30) scan.points.clear();
  };
  const Run run = run_odometry(moved, settings);
  CHECK(run.results[23].state == TrackingState::kTracking);
  CHECK(run.results[29].state == TrackingState::kLost);
  CHECK(run.results[29].pose_covariance(0, 0) > 10.0 * run.results[24].pose_covariance(0, 0));
  CHECK_FALSE(run.results[30].predicted);
  CHECK(run.results.back().state == TrackingState::kTracking);
  CHECK(run.end_error_m < 0.1);
}

TEST_CASE("a vehicle that left its map without scans resets it at the predicted pose and reports it",
          "[odometry]") {
  RunSettings settings;
  settings.scans = 90;
  settings.damage = [](int i, Scan& scan) {
    if (i >= 20 && i < 55) scan.points.clear();
    // Another place, of which the map holds no part.
    if (i >= 55) {
      for (Point& point : scan.points) point.x += 15.0F;
    }
  };
  const PoseFunction creeping = [](double t) {
    return SE3{Eigen::Quaterniond::Identity(), Vector3(t, 0.0, 0.0)};
  };
  const Run run = run_odometry(creeping, settings);
  CHECK(run.results[54].state == TrackingState::kLost);
  CHECK(run.results[55].state == TrackingState::kInitialising);
  CHECK(run.results[70].state == TrackingState::kTracking);
  const SE3 since = run.results[70].T_odom_base.inverse() * run.results[89].T_odom_base;
  CHECK(since.translation.x() == Approx(1.9).margin(0.1));
}

TEST_CASE("with an IMU the speed outlasts a gap that ends in an unknown tube", "[odometry]") {
  constexpr int kGapBegin = 30;
  constexpr int kGapEnd = 60;
  constexpr double kSpeed = 20.0;
  const PoseFunction fast = [](double t) { return winding_at(t, kSpeed, 0.1); };
  // The pillars end within the gap: scans of the bare tube do not show the speed.
  Room room = Room::with_pillars();
  room.low = {-500.0, -12.0, -1.8};
  room.high = {1000.0, 12.0, 5.0};
  Odometry odometry(OdometryConfig{});
  std::vector<OdometryResult> after_gap;
  int imu_index = -20;
  for (int i = 0; i < kGapEnd + 40; ++i) {
    for (; imu_index * 0.005 < (i + 1) * kPeriod + 0.01; ++imu_index)
      odometry.add_imu(imu_sample(fast, imu_index * 0.005, Vector3::Zero()));
    if (i >= kGapBegin && i < kGapEnd) continue;
    Scan scan = scan_room(room, fast, i * kPeriod, static_cast<std::uint64_t>(i));
    std::erase_if(scan.points, [](const Point& point) { return std::hypot(point.x, point.y) > 25.0F; });
    const OdometryResult result = odometry.register_scan(scan);
    if (i == kGapBegin - 1) CHECK(result.state == TrackingState::kTracking);
    if (i >= kGapEnd) after_gap.push_back(result);
  }
  CHECK(std::any_of(after_gap.begin(), after_gap.end(), [](const OdometryResult& result) {
    return result.state == TrackingState::kInitialising;
  }));
  for (const OdometryResult& result : after_gap) CHECK(result.twist[0] == Approx(kSpeed).margin(1.0));
}

TEST_CASE("a drive that continues in another place is lost, resets its map and tracks within 35 scans",
          "[odometry]") {
  constexpr int kSeam = 40;
  constexpr int kScans = 100;
  Room other;
  other.low = {-60.0, -9.0, -1.8};
  other.high = {45.0, 60.0, 7.0};
  for (int i = 0; i < 6; ++i) other.pillars.push_back({-25.0 + 9.0 * i, 4.0 + 3.0 * i, 0.6});
  const PoseFunction slower = [](double t) {
    const SE3 begin{Eigen::Quaterniond(Eigen::AngleAxisd(0.6, Vector3::UnitZ())), Vector3(-20.0, -3.0, 0.0)};
    return begin * SE3{Eigen::Quaterniond::Identity(), Vector3(3.0 * t - 12.0, 0.0, 0.0)};
  };
  const Room room = Room::with_pillars();
  for (const bool with_imu : {true, false}) {
    Odometry odometry(OdometryConfig{});
    std::vector<OdometryResult> results;
    int imu_index = -20;
    for (int i = 0; i < kScans; ++i) {
      for (; with_imu && imu_index * 0.005 < (i + 1) * kPeriod + 0.01; ++imu_index) {
        const double time = imu_index * 0.005;
        odometry.add_imu(imu_sample(time < kSeam * kPeriod ? winding : slower, time, Vector3::Zero()));
      }
      const bool is_other = i >= kSeam;
      results.push_back(odometry.register_scan(scan_room(is_other ? other : room, is_other ? slower : winding,
                                                         i * kPeriod, static_cast<std::uint64_t>(i))));
    }
    CHECK(results[kSeam - 1].state == TrackingState::kTracking);
    const auto said = [&](TrackingState state) {
      return std::any_of(results.begin() + kSeam, results.begin() + kSeam + 20,
                         [&](const OdometryResult& result) { return result.state == state; });
    };
    CHECK(said(TrackingState::kLost));
    CHECK(said(TrackingState::kInitialising));
    for (int i = kSeam; i < kSeam + 10; ++i) CHECK(results[i].state != TrackingState::kTracking);
    // Few beams show the way along the hall: single scans may be degraded.
    const auto tracked =
        std::count_if(results.begin() + kSeam + 35, results.end(),
                      [](const OdometryResult& result) { return result.state == TrackingState::kTracking; });
    CHECK(tracked >= kScans - kSeam - 35 - 2);
    const SE3 moved = results[kSeam + 35].T_odom_base.inverse() * results.back().T_odom_base;
    CHECK(moved.translation.x() == Approx(3.0 * kPeriod * (kScans - kSeam - 36)).margin(0.05));
    CHECK(so3_log(moved.rotation).norm() < 0.005);
  }
}

TEST_CASE("a sharp corner keeps the registered poses, without an IMU", "[odometry]") {
  // From straight on to 86 deg/s within 0.3 s.
  const auto yaw_at = [](double t) {
    const double since = std::clamp(t - 3.0, 0.0, 1.2);
    return since < 0.3 ? 2.5 * since * since : 1.5 * (since - 0.15);
  };
  const PoseFunction corner = [&](double t) {
    constexpr double kSpeed = 6.0;
    constexpr double kStep = 0.005;
    SE3 pose;
    for (double time = std::min(t, 0.0); time < t; time += kStep) {
      const double yaw = yaw_at(time + 0.5 * kStep);
      pose.translation += std::min(kStep, t - time) * kSpeed * Vector3(std::cos(yaw), std::sin(yaw), 0.0);
    }
    pose.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(yaw_at(t), Vector3::UnitZ()));
    return pose;
  };
  RunSettings settings;
  settings.scans = 50;
  const Run run = run_odometry(corner, settings);
  for (const OdometryResult& result : run.results) {
    CHECK_FALSE(result.predicted);
    CHECK(result.state != TrackingState::kLost);
  }
  CHECK(run.end_error_m < 0.5);
}

TEST_CASE("the covariance of a predicted pose grows with the time since the last registered one",
          "[odometry]") {
  const Room room = Room::with_pillars();
  Odometry odometry = driven_odometry(room);
  const auto deviation_after = [&](double seconds) {
    const Scan scan = scan_room(room, driving, 9 * kPeriod + seconds, 10);
    return std::sqrt(OdometryRuntime(odometry).predict_pose(scan).pose_covariance(0, 0));
  };
  // Over a gap manoeuvres are white acceleration of 8 m^2/s^3, but for the 0.3 s that they last.
  for (const double seconds : {1.0, 4.0}) {
    const double expected = std::sqrt(8.0 * seconds * seconds * seconds / 3.0);
    CHECK(deviation_after(seconds) > 0.7 * expected);
    CHECK(deviation_after(seconds) < 1.2 * expected);
  }
}

TEST_CASE("the pose of a scan that is not registered does not depend on a host clock that was set",
          "[odometry]") {
  const Room room = Room::with_pillars();
  Odometry odometry = driven_odometry(room);
  Scan scan = scan_room(room, driving, 10 * kPeriod, 10);
  const OdometryResult expected = OdometryRuntime(odometry).predict_pose(scan);
  scan.after_time_jump = true;
  scan.clock_step = Duration::from_seconds(3600.0);
  scan.start = scan.start + scan.clock_step;
  scan.end = scan.end + scan.clock_step;
  const OdometryResult result = OdometryRuntime(odometry).predict_pose(scan);
  CHECK(result.T_odom_base.translation == expected.T_odom_base.translation);
  CHECK(result.pose_covariance == expected.pose_covariance);
}

TEST_CASE("scans of few points start a map where none is", "[odometry]") {
  RunSettings settings;
  settings.scans = 20;
  settings.damage = [](int i, Scan& scan) {
    std::vector<Point> few;
    for (std::size_t k = 0; i > 2 && k < scan.points.size(); k += 40) few.push_back(scan.points[k]);
    scan.points = few;
  };
  const Run run = run_odometry([](double) { return SE3{}; }, settings);
  CHECK(run.results.back().points_filtered > 0);
  CHECK(run.results.back().points_filtered < 500);
  CHECK(run.results.back().map_voxels > 0);
}

TEST_CASE("a few hundred returns a scan are tracked beside an IMU, from the start on", "[odometry]") {
  // Sets off after two seconds, with 2 m/s^2.
  const PoseFunction setting_off = [](double t) {
    const double moved_s = std::max(0.0, t - 2.0);
    return SE3{Eigen::Quaterniond::Identity(), Vector3(moved_s * moved_s, 0.0, 0.0)};
  };
  std::mt19937_64 random(7);
  RunSettings settings;
  settings.imu = true;
  settings.damage = [&](int, Scan& scan) {
    std::shuffle(scan.points.begin(), scan.points.end(), random);
    scan.points.resize(300);
  };
  const Run run = run_odometry(setting_off, settings);
  CHECK(run.worst_error_m < 0.3);
  for (std::size_t i = 5; i < run.results.size(); ++i) {
    CHECK(run.results[i].state != TrackingState::kInitialising);
    CHECK(run.results[i].state != TrackingState::kLost);
  }
}

TEST_CASE("a published step that no vehicle can have driven is lost for a second", "[odometry]") {
  const PoseFunction jumping = [](double t) {
    return t < 3.01 ? SE3{} : SE3{Eigen::Quaterniond::Identity(), Vector3(-4.0, 1.0, 0.0)};
  };
  const Run run = run_odometry(jumping, {});
  std::size_t jump = 0;
  for (std::size_t i = 6; i < run.results.size(); ++i) {
    const SE3 step = run.results[i - 1].T_odom_base.inverse() * run.results[i].T_odom_base;
    if (step.translation.norm() > 2.0) jump = i;
  }
  REQUIRE(jump > 0);
  // Ten scans in a second.
  REQUIRE(jump + 11 < run.results.size());
  for (std::size_t i = jump; i < jump + 10; ++i) CHECK(run.results[i].state == TrackingState::kLost);
  for (std::size_t i = jump + 11; i < run.results.size(); ++i)
    CHECK(run.results[i].state == TrackingState::kTracking);
}
