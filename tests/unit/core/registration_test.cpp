#include "core/src/registration/registration.hpp"

#include "core/src/preprocessing/normal_space_sampling.hpp"
#include "tests/support/synthetic_room.hpp"

#include <random>
#include <span>

#include <catch2/catch.hpp>
#include <tbb/task_arena.h>

using namespace nilio::core;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

struct RoomMap {
  VoxelMap planes{{1.5, 200.0, 40000, 6, 100}};
  VoxelMap coarse{{2.0, 200.0, 40000, 6, 100}};
  std::vector<Eigen::Vector3f> points;  ///< one scan from the origin

  RoomMap() {
    const Room room = Room::with_pillars();
    for (int i = 0; i < 5; ++i) {
      const SE3 pose{Eigen::Quaterniond::Identity(), Vector3(0.7 * i - 1.4, 0.3 * i, 0.0)};
      std::vector<Vector3> world;
      for (const Point& p : scan_room(
                                room, [&](double) { return pose; }, 0.0, static_cast<std::uint64_t>(i))
                                .points) {
        world.push_back(pose * Vector3(p.x, p.y, p.z));
      }
      planes.insert(world);
      coarse.insert(world);
    }
    const Scan scan = scan_room(
        room, [](double) { return SE3{}; }, 0.0, 99);
    for (std::size_t i = 0; i < scan.points.size(); i += 8)
      points.emplace_back(scan.points[i].x, scan.points[i].y, scan.points[i].z);
  }
};

const RoomMap& room_map() {
  static const RoomMap map;
  return map;
}

SE3 offset(double x, double y, double yaw) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())), Vector3(x, y, 0.05)};
}

}  // namespace

TEST_CASE("the gradient of the plane equations is that of the squared distances, numerically",
          "[registration]") {
  // Without weights that move with the point: a huge kernel, and planes that are certain beside the points.
  const PlaneMetric metric{2.0, 1e6, 0.1, 0.2, 1e3};
  const SE3 pose = offset(0.05, -0.03, 0.004);
  const auto cost = [&](const Vector6& delta) {
    return 0.5 * plane_equations(room_map().planes, room_map().points, pose * se3_exp(delta), metric)
                     .weighted_square_error;
  };
  const NormalEquations equations = plane_equations(room_map().planes, room_map().points, pose, metric);
  for (int i = 0; i < 6; ++i) {
    // Small enough that no point changes its voxel in a way that matters.
    const double step = 1e-7;
    Vector6 delta = Vector6::Zero();
    delta[i] = step;
    const double numeric = (cost(delta) - cost(-delta)) / (2.0 * step);
    CAPTURE(i);
    CHECK(equations.b[i] == Approx(numeric).epsilon(1e-3).margin(1e-3));
  }
}

namespace {

/// A scan from the origin while base_link moves with a constant twist, deskewed with none.
struct TurningScan {
  Vector6 twist;
  std::vector<Eigen::Vector3f> points;
  std::vector<float> times_s;

  explicit TurningScan(const Vector6& twist_of_base) : twist(twist_of_base) {
    constexpr double kMiddle = 0.05;
    const Scan scan = scan_room(
        Room::with_pillars(), [&](double t) { return se3_exp((t - kMiddle) * twist); }, 0.0, 99);
    for (std::size_t i = 0; i < scan.points.size(); i += 8) {
      points.emplace_back(scan.points[i].x, scan.points[i].y, scan.points[i].z);
      times_s.push_back(static_cast<float>(scan.points[i].time_offset_ns * 1e-9 - kMiddle));
    }
  }
};

}  // namespace

TEST_CASE("the gradient of the plane equations by the twist is that of the squared distances, numerically",
          "[registration]") {
  const TurningScan scan(Vector6::Zero());
  const PlaneMetric metric{2.0, 1e6, 0.1, 0.2, 1e3};
  const SweepProblem problem{scan.times_s, Vector6::Zero(), {}};
  const auto equations_at = [&](const Vector6& twist) {
    return plane_equations(room_map().planes, scan.points, offset(0.05, -0.03, 0.004), metric,
                           {&problem, twist});
  };
  const NormalEquations equations = equations_at(Vector6::Zero());
  for (int i = 0; i < 6; ++i) {
    const double step = 1e-6;
    Vector6 delta = Vector6::Zero();
    delta[i] = step;
    const double numeric =
        0.5 * (equations_at(delta).weighted_square_error - equations_at(-delta).weighted_square_error) /
        (2.0 * step);
    CAPTURE(i);
    CHECK(equations.b_twist[i] == Approx(numeric).epsilon(1e-3).margin(1e-3));
  }
}

TEST_CASE("a sweep shows a twist that its deskewing did not know, and how well", "[registration]") {
  const TurningScan scan((Vector6() << 2.0, 0.3, 0.0, 0.0, 0.05, 0.8).finished());
  SweepProblem problem{scan.times_s, Vector6::Zero(), {}};
  problem.prior.covariance.diagonal() << Vector6::Constant(0.1 * 0.1), Vector6::Constant(3.0 * 3.0);
  PlaneMetric metric{0.3, 0.05, 0.1, 0.2};
  metric.guess_covariance = problem.prior.covariance.topLeftCorner<6, 6>();
  SolverOptions options;
  options.max_iterations = 20;
  options.sweep = &problem;
  const RegistrationResult result = register_planes(room_map().planes, scan.points, {}, metric, options);
  CHECK(result.stop_reason == StopReason::kConverged);
  const Vector6 off = result.twist - scan.twist;
  CHECK(off.head<3>().norm() < 0.5);
  // To first order of the turn; deskewing with the found twist comes next.
  CHECK(off.tail<3>().norm() < 0.05);
  CHECK(result.T_map_moving.translation.norm() < 0.03);
  CHECK(so3_log(result.T_map_moving.rotation).norm() < 2e-3);
  const Matrix12 covariance = result.sweep_information.inverse();
  const double distance = off.dot(covariance.bottomRightCorner<6, 6>().inverse() * off);
  CHECK(distance < 22.46);
  CHECK(std::sqrt(covariance(11, 11)) < 0.02);

  SECTION("a prior that is sure of another twist keeps it") {
    problem.prior.covariance.diagonal().tail<6>().setConstant(1e-8);
    const RegistrationResult held = register_planes(room_map().planes, scan.points, {}, metric, options);
    CHECK(held.twist.norm() < 1e-3);
  }
}

TEST_CASE("the gradient of the NDT equations is that of the weighted score, numerically", "[registration]") {
  const SE3 pose = offset(0.3, -0.2, 0.01);
  const double scale = 1.5;
  // d/dT of sum(-s^2 exp(-m^2 / 2 s^2)) is sum(exp(..) J^T information e).
  const auto score = [&](const Vector6& delta) {
    double sum = 0.0;
    for (const Eigen::Vector3f& p : room_map().points) {
      const std::vector<Eigen::Vector3f> one{p};
      sum +=
          -scale * scale * ndt_equations(room_map().coarse, one, pose * se3_exp(delta), {scale}).weight_sum;
    }
    return sum;
  };
  const NormalEquations equations = ndt_equations(room_map().coarse, room_map().points, pose, {scale});
  for (int i = 0; i < 6; ++i) {
    // Small enough that no point changes its voxel on the way.
    const double step = 1e-8;
    Vector6 delta = Vector6::Zero();
    delta[i] = step;
    const double numeric = (score(delta) - score(-delta)) / (2.0 * step);
    CAPTURE(i);
    CHECK(equations.b[i] == Approx(numeric).epsilon(2e-3).margin(0.05));
  }
}

TEST_CASE("ICP converges from half a metre and two degrees away", "[registration]") {
  const PlaneMetric metric{1.5, 0.5, 0.1, 0.2};
  SolverOptions options;
  options.max_iterations = 30;
  const RegistrationResult result =
      register_planes(room_map().planes, room_map().points, offset(0.4, -0.3, 0.035), metric, options);
  CHECK(result.stop_reason == StopReason::kConverged);
  CHECK(result.T_map_moving.translation.norm() < 0.02);
  CHECK(so3_log(result.T_map_moving.rotation).norm() < 1e-3);
}

TEST_CASE("NDT with a wide kernel first reaches farther than ICP", "[registration]") {
  const SE3 guess = offset(2.5, 1.0, 0.05);
  SolverOptions options;
  options.max_iterations = 20;
  const RegistrationResult fine =
      register_planes(room_map().planes, room_map().points, guess, {1.5, 0.5, 0.1, 0.2}, options);
  const std::array<double, 2> schedule = {5.0, 2.0};
  const RegistrationResult coarse =
      register_ndt(room_map().coarse, room_map().points, guess, schedule, options);
  CHECK(fine.T_map_moving.translation.norm() > 0.5);
  CHECK(coarse.T_map_moving.translation.norm() < 0.2);
}

TEST_CASE("the equations are the same to the last bit at any number of threads", "[registration]") {
  const SE3 pose = offset(0.1, 0.05, 0.01);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 8; ++i) points.insert(points.end(), room_map().points.begin(), room_map().points.end());
  std::optional<NormalEquations> planes;
  std::optional<NormalEquations> ndt;
  for (const int threads : {1, 2, 4}) {
    tbb::task_arena arena(threads);
    for (int run = 0; run < 20; ++run) {
      arena.execute([&] {
        const NormalEquations p = plane_equations(room_map().planes, points, pose, {});
        const NormalEquations n = ndt_equations(room_map().coarse, points, pose, {});
        if (!planes) planes = p;
        if (!ndt) ndt = n;
        CHECK(p.H == planes->H);
        CHECK(p.b == planes->b);
        CHECK(n.H == ndt->H);
        CHECK(n.b == ndt->b);
      });
    }
  }
}

TEST_CASE("registration against an empty map reports too few points", "[registration]") {
  const VoxelMap empty({1.0, 100.0, 100, 6, 100});
  const RegistrationResult result = register_planes(empty, room_map().points, {}, {}, {});
  CHECK(result.stop_reason == StopReason::kTooFewPoints);
  CHECK(result.T_map_moving.translation.norm() == 0.0);
}

TEST_CASE(
    "between two parallel walls the direction along them keeps the prediction and is reported as degenerate",
    "[registration]") {
  VoxelMap map({1.0, 500.0, 20000, 6, 100});
  std::mt19937_64 generator(5);
  std::uniform_real_distribution<double> along(-60.0, 60.0);
  std::uniform_real_distribution<double> up(-1.5, 4.0);
  std::vector<Vector3> world;
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 60000; ++i) {
    world.emplace_back(along(generator), i % 3 == 0 ? 4.5 : -4.5, up(generator));
    if (i % 3 == 2) world.back() = Vector3(along(generator), up(generator) - 1.0, -1.6);
  }
  map.insert(world);
  for (std::size_t i = 0; i < 3000; ++i) {
    if (std::abs(world[i].x()) < 30.0) points.push_back((world[i] - Vector3(0.0, 0.05, 0.0)).cast<float>());
  }
  const SE3 guess{Eigen::Quaterniond::Identity(), Vector3(0.4, 0.0, 0.0)};
  const RegistrationResult result = register_planes(map, points, guess, {}, {});
  CHECK((result.degenerate_axes & 0b1) != 0);
  CHECK(result.T_map_moving.translation.x() == Approx(0.4).margin(1e-3));
  CHECK(result.T_map_moving.translation.y() == Approx(0.05).margin(0.01));
}

TEST_CASE("selection takes an equal share of every surface direction and never more than it was asked for",
          "[registration]") {
  NormalSpaceSampler selector(40000);
  VoxelDownsampler filter(40000);
  std::vector<std::uint32_t> selection;
  selector.select(room_map().planes, filter, room_map().points, {}, {200, 0.2F, 0.1}, selection);
  CHECK(selection.size() <= 200);
  CHECK(selection.size() > 150);
  CHECK(std::is_sorted(selection.begin(), selection.end()));
  CHECK(std::adjacent_find(selection.begin(), selection.end()) == selection.end());
  std::size_t ground = 0;
  for (const std::uint32_t index : selection) ground += room_map().points[index].z() < -1.7F ? 1 : 0;
  // Uniform choice would take most points from the ground here.
  CHECK(ground < selection.size() / 2);
}

TEST_CASE("a point beside the strip that a plane was fitted to weighs less than one on it",
          "[registration]") {
  VoxelMap map({2.0, 100.0, 100, 6, 100});
  std::mt19937_64 generator(7);
  std::uniform_real_distribution<double> along(-0.9, 0.9);
  std::uniform_real_distribution<double> across(-0.2, 0.2);
  std::normal_distribution<double> height(0.0, 0.02);
  std::vector<Vector3> world;
  for (int i = 0; i < 99; ++i)
    world.emplace_back(1.0 + along(generator), 1.0 + across(generator), 1.0 + height(generator));
  // Four scans, after which a plane has its full weight.
  for (std::size_t scan = 0; scan < 4; ++scan)
    map.insert(std::span<const Vector3>(world).subspan(scan * world.size() / 4, world.size() / 4));
  const auto weight_at = [&](float x, float y) {
    const std::vector<Eigen::Vector3f> point{{x, y, 1.0F}};
    const NormalEquations equations = plane_equations(map, point, SE3{}, {});
    REQUIRE(equations.correspondences == 1);
    return equations.weight_sum;
  };
  CHECK(weight_at(1.0F, 1.0F) > 0.3);
  CHECK(weight_at(1.8F, 1.0F) > 0.3 * weight_at(1.0F, 1.0F));
  CHECK(weight_at(1.0F, 1.8F) < 0.2 * weight_at(1.0F, 1.0F));
}

TEST_CASE("a plane seen by one scan has a sixth of the weight of one seen by six", "[registration]") {
  const auto weight_after = [](std::size_t scans) {
    VoxelMap map({2.0, 100.0, 100, 6, 100});
    std::mt19937_64 generator(7);
    std::uniform_real_distribution<double> within(0.1, 1.9);
    std::vector<Vector3> world;
    for (int i = 0; i < 96; ++i) world.emplace_back(within(generator), within(generator), 1.0);
    for (std::size_t scan = 0; scan < scans; ++scan) {
      map.insert(std::span<const Vector3>(world).subspan(scan * world.size() / scans, world.size() / scans));
    }
    const std::vector<Eigen::Vector3f> point{{1.0F, 1.0F, 1.0F}};
    return plane_equations(map, point, SE3{}, {}).weight_sum;
  };
  CHECK(weight_after(1) == Approx(weight_after(6) / 6.0).epsilon(0.05));
  CHECK(weight_after(12) == Approx(weight_after(6)).epsilon(0.05));
}

TEST_CASE("voxels without a plane are chosen from and registered against as Gaussians", "[registration]") {
  // Bushes: clouds of points.
  std::mt19937_64 generator(11);
  std::normal_distribution<double> spread(0.0, 0.25);
  std::vector<Vector3> world;
  for (int i = 0; i < 200; ++i) {
    const Vector3 centre(2.0 * (i % 20) - 19.0, 4.0 * (i / 20) - 19.0, 1.0 + 2.0 * (i % 2));
    for (int k = 0; k < 60; ++k)
      world.emplace_back(centre + Vector3(spread(generator), spread(generator), spread(generator)));
  }
  VoxelMap map({2.0, 100.0, 4000, 6, 100});
  for (int scan = 0; scan < 4; ++scan) map.insert(world);
  const Vector3 offset(0.15, -0.1, 0.05);
  std::vector<Eigen::Vector3f> points;
  for (std::size_t i = 0; i < world.size(); i += 7) points.push_back((world[i] - offset).cast<float>());
  NormalSpaceSampler selector(40000);
  VoxelDownsampler filter(40000);
  std::vector<std::uint32_t> selection;
  selector.select(map, filter, points, {}, {2000, 0.2F, 0.1}, selection);
  CHECK(selection.size() > 200);
  SolverOptions options;
  options.max_iterations = 30;
  const RegistrationResult result = register_planes(map, points, {}, {}, options);
  CHECK(result.stop_reason == StopReason::kConverged);
  CHECK((result.T_map_moving.translation - offset).norm() < 0.03);
  CHECK(result.equations.agreement > plane_equations(map, points, {}, {}).agreement);
}
