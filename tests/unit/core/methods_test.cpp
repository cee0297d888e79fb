#include "core/src/registration/methods.hpp"

#include "nilio/core/odometry.hpp"

#include "core/src/registration/point_factors.hpp"
#include "tests/support/synthetic_room.hpp"

#include <set>

#include <Eigen/SVD>
#include <catch2/catch.hpp>
#include <tbb/task_arena.h>

using namespace nilio::core;
using nilio::tests::Room;
using nilio::tests::scan_room;

namespace {

struct RoomMaps {
  VoxelMap planes{{1.5, 200.0, 40000, 6, 100}};
  VoxelMap gaussians{{2.0, 200.0, 40000, 6, 100}};
  PointMap stored{{1.0, 200.0, 40000}};
  std::vector<Eigen::Vector3f> points;  ///< one scan from the origin

  RoomMaps() {
    const Room room = Room::with_pillars();
    for (int i = 0; i < 5; ++i) {
      const SE3 pose{Eigen::Quaterniond::Identity(), Vector3(0.7 * i - 1.4, 0.3 * i, 0.0)};
      std::vector<Vector3> world;
      const Scan scan = scan_room(
          room, [&](double) { return pose; }, 0.0, static_cast<std::uint64_t>(i));
      for (const Point& p : scan.points) world.push_back(pose * Vector3(p.x, p.y, p.z));
      planes.insert(world);
      gaussians.insert(world);
      stored.insert(world);
    }
    const Scan scan = scan_room(
        room, [](double) { return SE3{}; }, 0.0, 99);
    for (std::size_t i = 0; i < scan.points.size(); i += 8)
      points.emplace_back(scan.points[i].x, scan.points[i].y, scan.points[i].z);
  }
  [[nodiscard]] RegistrationMaps maps() const { return {&planes, &gaussians, &stored}; }
};

const RoomMaps& room_maps() {
  static const RoomMaps maps;
  return maps;
}

SE3 offset(double x, double y, double yaw) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Vector3::UnitZ())), Vector3(x, y, 0.05)};
}

using Equations = NormalEquations (*)(const PointMap&, std::span<const Eigen::Vector3f>, const SE3&,
                                      const PlaneMetric&);

/// b against central differences of half the squared distances.
void check_gradient(Equations equations) {
  // Without robust weights moving with the residual: a huge kernel.
  const PlaneMetric metric{1.0, 1e6, 0.1, 0.2};
  const SE3 pose = offset(0.05, -0.03, 0.004);
  const auto cost = [&](const Vector6& delta) {
    return 0.5 * equations(room_maps().stored, room_maps().points, pose * se3_exp(delta), metric)
                     .weighted_square_error;
  };
  const NormalEquations analytic = equations(room_maps().stored, room_maps().points, pose, metric);
  REQUIRE(analytic.correspondences > 100);
  for (int i = 0; i < 6; ++i) {
    // Small enough that no point changes its neighbours in a way that matters.
    const double step = 1e-7;
    Vector6 delta = Vector6::Zero();
    delta[i] = step;
    const double numeric = (cost(delta) - cost(-delta)) / (2.0 * step);
    CAPTURE(i);
    CHECK(analytic.b[i] == Approx(numeric).epsilon(1e-3).margin(1e-2));
  }
}

/// The pose that brings pairs of points together best, in closed form (Arun 1987).
SE3 closed_form(const std::vector<Vector3>& from, const std::vector<Vector3>& to) {
  Vector3 mean_from = Vector3::Zero();
  Vector3 mean_to = Vector3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    mean_from += from[i] / static_cast<double>(from.size());
    mean_to += to[i] / static_cast<double>(from.size());
  }
  Matrix3 products = Matrix3::Zero();
  for (std::size_t i = 0; i < from.size(); ++i)
    products += (to[i] - mean_to) * (from[i] - mean_from).transpose();
  const Eigen::JacobiSVD<Matrix3> svd(products, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Matrix3 sign = Matrix3::Identity();
  sign(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant();
  const Matrix3 R = svd.matrixU() * sign * svd.matrixV().transpose();
  return {Eigen::Quaterniond(R), mean_to - R * mean_from};
}

}  // namespace

TEST_CASE("the gradient of the point equations is that of the squared distances, numerically", "[methods]") {
  check_gradient(point_equations);
}

TEST_CASE("the gradient of the line equations is that of the squared distances, numerically", "[methods]") {
  check_gradient(line_equations);
}

TEST_CASE("point-to-point ICP by Gauss-Newton ends where ICP by SVD ends", "[methods]") {
  const PlaneMetric metric{1.0, 1e6, 0.1, 0.2};
  const SE3 guess = offset(0.15, -0.1, 0.01);
  SE3 by_svd = guess;
  for (int i = 0; i < 300; ++i) {
    std::vector<Vector3> from;
    std::vector<Vector3> to;
    for (const Eigen::Vector3f& point : room_maps().points) {
      std::array<PointMap::Neighbour, 1> nearest;
      const Vector3 p = point.cast<double>();
      if (room_maps().stored.find_nearest(by_svd * p, metric.gate_m, nearest) == 0) continue;
      from.push_back(p);
      to.push_back(nearest[0].position);
    }
    by_svd = closed_form(from, to);
  }
  SolverOptions options;
  options.max_iterations = 300;
  options.translation_epsilon_m = 1e-9;
  options.rotation_epsilon_rad = 1e-10;
  const RegistrationResult by_newton =
      register_points(room_maps().stored, room_maps().points, guess, metric, options);
  CHECK(by_newton.stop_reason == StopReason::kConverged);
  const SE3 difference = by_svd.inverse() * by_newton.T_map_moving;
  CHECK(difference.translation.norm() < 1e-4);
  CHECK(so3_log(difference.rotation).norm() < 1e-5);
}

TEST_CASE("every method converges from a third of a metre and a degree away", "[methods]") {
  for (const RegistrationMethodInfo& method : registration_methods()) {
    CAPTURE(method.name);
    SolverOptions options;
    options.max_iterations = 60;
    const RegistrationResult result = method.refine(room_maps().maps(), room_maps().points,
                                                    offset(0.25, -0.2, 0.017), {1.5, 0.5, 0.1, 0.2}, options);
    CHECK(result.T_map_moving.translation.norm() < 0.1);
    CHECK(so3_log(result.T_map_moving.rotation).norm() < 5e-3);
    CHECK(result.equations.inliers > room_maps().points.size() / 3);
  }
}

TEST_CASE("every method gives the same bits at any number of threads", "[methods]") {
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 8; ++i)
    points.insert(points.end(), room_maps().points.begin(), room_maps().points.end());
  for (const RegistrationMethodInfo& method : registration_methods()) {
    CAPTURE(method.name);
    std::optional<SE3> reference;
    for (const int threads : {1, 2, 4}) {
      tbb::task_arena arena(threads);
      arena.execute([&] {
        const SE3 pose =
            method.refine(room_maps().maps(), points, offset(0.1, 0.05, 0.01), {}, {}).T_map_moving;
        if (!reference) reference = pose;
        CHECK(pose.translation == reference->translation);
        CHECK(pose.rotation.coeffs() == reference->rotation.coeffs());
      });
    }
  }
}

TEST_CASE("methods have unique names and are found by them", "[methods]") {
  std::set<std::string> names;
  for (const RegistrationMethodInfo& method : registration_methods()) {
    names.insert(method.name);
    REQUIRE(find_registration_method(method.name) == &method);
    CHECK(&info_of(method.method) == &method);
  }
  CHECK(names.size() == registration_methods().size());
  CHECK(registration_methods().front().method == OdometryConfig{}.registration);
  CHECK(find_registration_method("loam") == nullptr);
}

TEST_CASE("the methods with surfaces track a drive through the room", "[methods]") {
  const Room room = Room::with_pillars();
  const auto drive = [](double t) {
    return SE3{Eigen::Quaterniond(Eigen::AngleAxisd(0.1 * t, Vector3::UnitZ())), Vector3(2.0 * t, 0.0, 0.0)};
  };
  for (const RegistrationMethodInfo& method : registration_methods()) {
    // A flat floor's rings look the same from everywhere: points alone indicate no motion.
    if (method.needs_points) continue;
    CAPTURE(method.name);
    OdometryConfig config;
    config.registration = method.method;
    Odometry odometry(config);
    OdometryResult result;
    SE3 first;
    std::size_t predicted = 0;
    for (int i = 0; i < 20; ++i) {
      const Scan scan = scan_room(room, drive, 0.1 * i, static_cast<std::uint64_t>(i));
      result = odometry.register_scan(scan);
      predicted += result.predicted ? 1 : 0;
      if (i == 0) first = drive(scan.end.seconds()).inverse();
    }
    const SE3 truth = first * drive(result.scan_end.seconds());
    const double error_m = (result.T_odom_base.translation - truth.translation).norm();
    CAPTURE(error_m, predicted);
    CHECK(error_m < 0.3);
    CHECK(predicted == 0);
  }
}
