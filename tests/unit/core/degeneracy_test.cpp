#include "core/src/registration/registration.hpp"

#include <array>
#include <cmath>
#include <random>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio::core;

namespace {

/// A street of two walls and a floor along x, seen with 2 cm of noise; with gables across it or without.
struct Corridor {
  VoxelMap map{{1.0, 500.0, 40000, 6, 100}};
  std::vector<Eigen::Vector3f> points;

  explicit Corridor(bool gables) {
    std::mt19937_64 generator(5);
    std::normal_distribution<double> noise(0.0, 0.02);
    std::vector<Vector3> world;
    for (int i = 0; i < 90000; ++i) world.push_back(place(i, gables, generator) + error(noise, generator));
    map.insert(world);
    for (int i = 0; i < 2000; ++i) {
      const Vector3 p = place(i, gables, generator) + error(noise, generator);
      if (std::abs(p.x()) < 30.0) points.push_back(p.cast<float>());
    }
  }

 private:
  template <class Noise>
  static Vector3 error(Noise& noise, std::mt19937_64& generator) {
    return {noise(generator), noise(generator), noise(generator)};
  }
  static Vector3 place(int i, bool gables, std::mt19937_64& generator) {
    std::uniform_real_distribution<double> along(-40.0, 40.0);
    std::uniform_real_distribution<double> up(-1.5, 4.0);
    const double x = along(generator);
    const double z = up(generator);
    if (i % 3 == 2) return {x, z - 1.0, -1.6};
    if (gables && i % 30 == 0) return {i % 60 == 0 ? 10.4 : -15.4, 7.0 + up(generator), z};
    return {x, i % 3 == 0 ? 4.5 : -4.5, z};
  }
};

/// Level ground as 40 beams see it whose calibration is wrong by 5 mm in height, from the beginning of a
/// drive and 0.3 m further on; with two rows of posts or without.
struct Plain {
  static constexpr double kDrivenM = 0.3;
  VoxelMap map{{1.0, 500.0, 40000, 6, 100}};
  std::vector<Eigen::Vector3f> points;

  explicit Plain(bool posts) {
    std::mt19937_64 generator(9);
    std::normal_distribution<double> error(0.0, 0.005);
    std::array<double, 40> beams{};
    for (double& beam : beams) beam = error(generator);
    std::vector<Vector3> world;
    std::vector<float> numbers;
    for (int scan = 0; scan < 6; ++scan) {
      for (int i = 0; i < 20000; ++i) {
        world.push_back(on_ground(i, beams, generator));
        numbers.push_back(static_cast<float>(i % 40));
      }
      for (int i = 0; posts && i < 600; ++i) {
        world.push_back(on_post(i, generator));
        numbers.push_back(static_cast<float>(i % 7));
      }
      map.insert(world, numbers);
      world.clear();
      numbers.clear();
    }
    for (int i = 0; i < 2000; ++i) points.push_back(on_ground(i, beams, generator).cast<float>());
    for (int i = 0; posts && i < 60; ++i)
      points.push_back((on_post(i, generator) - Vector3(kDrivenM, 0.0, 0.0)).cast<float>());
  }

 private:
  /// The errors of the beams belong to the sensor.
  static Vector3 on_ground(int i, const std::array<double, 40>& beams, std::mt19937_64& generator) {
    std::uniform_real_distribution<double> direction(-3.14159, 3.14159);
    std::normal_distribution<double> noise(0.0, 0.005);
    const auto beam = static_cast<std::size_t>(i % 40);
    const double radius = 1.7 / std::tan(0.05 + 0.008 * static_cast<double>(beam));
    const double azimuth = direction(generator);
    return {radius * std::cos(azimuth), radius * std::sin(azimuth), beams[beam] + noise(generator) - 1.7};
  }
  /// Faces of 0.4 m across the road, every 8 m on both sides.
  static Vector3 on_post(int i, std::mt19937_64& generator) {
    std::uniform_real_distribution<double> across(-0.2, 0.2);
    std::uniform_real_distribution<double> up(0.0, 2.0);
    std::normal_distribution<double> noise(0.0, 0.01);
    const double x = 8.0 * (i % 3 - 1) + 0.5;
    return {x + noise(generator), (i % 2 == 0 ? 4.5 : -4.5) + across(generator), up(generator) - 1.0};
  }
};

PosePrior prior_at(double x_m, double deviation_m = 0.1) {
  PosePrior prior;
  prior.T_map_moving.translation.x() = x_m;
  Vector6 variance;
  variance << Vector3::Constant(deviation_m * deviation_m), Vector3::Constant(0.01 * 0.01);
  prior.covariance = variance.asDiagonal();
  return prior;
}

RegistrationResult register_in(const Corridor& corridor, const PosePrior& prior) {
  SolverOptions options;
  options.max_iterations = 20;
  options.prior = prior;
  return register_planes(corridor.map, corridor.points, prior.T_map_moving, {}, options);
}

}  // namespace

TEST_CASE("between bare walls the pose follows the prediction along them, and that axis alone is degenerate",
          "[degeneracy]") {
  const Corridor corridor(false);
  PosePrior prior = prior_at(0.4);
  prior.T_map_moving.translation.y() = 0.05;
  const RegistrationResult result = register_in(corridor, prior);
  CHECK(result.degenerate_axes == 0b000001);
  CHECK(result.T_map_moving.translation.x() == Approx(0.4).margin(0.01));
  CHECK(result.T_map_moving.translation.y() == Approx(0.0).margin(0.005));
  CHECK(result.observability[0] < 0.2);
  CHECK(result.observability[1] > 0.9);
}

TEST_CASE("a few gables across the street are enough to observe the position along it", "[degeneracy]") {
  const Corridor corridor(true);
  const RegistrationResult result = register_in(corridor, prior_at(0.1));
  CHECK(result.degenerate_axes == 0);
  CHECK(result.T_map_moving.translation.x() == Approx(0.0).margin(0.01));
  CHECK(result.observability[0] > 0.9);
}

TEST_CASE("errors of beams on level ground do not hold a vehicle that sets off", "[degeneracy]") {
  const Plain plain(false);
  const PosePrior prior = prior_at(Plain::kDrivenM);
  const RegistrationResult result =
      register_planes(plain.map, plain.points, prior.T_map_moving, {}, {.prior = prior});
  CHECK(result.T_map_moving.translation.x() == Approx(Plain::kDrivenM).margin(0.01));
  CHECK(result.observability[0] < 0.2);
  CHECK((result.degenerate_axes & 0b000001) != 0);
}

TEST_CASE(
    "errors of normals on level ground show no yaw, and what they add to it is what is expected of them",
    "[degeneracy]") {
  std::mt19937_64 generator(11);
  std::normal_distribution<double> noise(0.0, 0.03);
  std::uniform_real_distribution<double> across(-30.0, 30.0);
  const auto on_ground = [&] {
    return Vector3(across(generator), across(generator), noise(generator) - 1.7);
  };
  VoxelMap map{{1.0, 500.0, 40000, 6, 100}};
  std::vector<Vector3> world;
  for (int i = 0; i < 60000; ++i) world.push_back(on_ground());
  map.insert(world);
  std::vector<Eigen::Vector3f> points;
  for (int i = 0; i < 2000; ++i) points.push_back(on_ground().cast<float>());
  const NormalEquations equations = plane_equations(map, points, {}, {});
  for (const int axis : {0, 1, 5}) {
    INFO("axis " << axis);
    CHECK(equations.H(axis, axis) > 0.3 * equations.H_normals(axis, axis));
    CHECK(equations.H(axis, axis) < 2.0 * equations.H_normals(axis, axis));
  }
  for (const int axis : {2, 3, 4}) CHECK(equations.H(axis, axis) > 100.0 * equations.H_normals(axis, axis));
  PosePrior prior = prior_at(0.0);
  prior.T_map_moving = se3_exp((Vector6() << 0.0, 0.0, 0.0, 0.0, 0.0, 0.01).finished());
  const RegistrationResult result = register_planes(map, points, prior.T_map_moving, {}, {.prior = prior});
  CHECK(result.observability[5] < 0.2);
  CHECK((result.degenerate_axes & 0b100011) == 0b100011);
  CHECK(se3_log(prior.T_map_moving.inverse() * result.T_map_moving)[5] == Approx(0.0).margin(0.001));
}

TEST_CASE("a few posts beside level ground are enough to observe the position along the road",
          "[degeneracy]") {
  const Plain plain(true);
  const PosePrior prior = prior_at(Plain::kDrivenM - 0.1);
  const RegistrationResult result =
      register_planes(plain.map, plain.points, prior.T_map_moving, {}, {.prior = prior});
  CHECK(result.T_map_moving.translation.x() == Approx(Plain::kDrivenM).margin(0.02));
  CHECK(result.observability[0] > 0.9);
}

TEST_CASE("a prediction and a scan are weighed by their covariances", "[degeneracy]") {
  const Corridor corridor(true);
  double before = 0.0;
  for (const double deviation : {0.1, 0.02, 0.005, 0.001}) {
    const RegistrationResult result = register_in(corridor, prior_at(0.1, deviation));
    const double expected = 0.1 * (1.0 - result.observability[0]);
    CHECK(result.T_map_moving.translation.x() == Approx(expected).margin(0.01));
    CHECK(result.T_map_moving.translation.x() > before);
    before = result.T_map_moving.translation.x();
  }
}

TEST_CASE("beside an IMU a variance that is larger than required counts with its square", "[degeneracy]") {
  const double required_m = 0.05;
  const double shared_m = 0.007;
  // A tenth of the points: the gables show the position along the street to centimetres.
  Corridor corridor(true);
  corridor.points.resize(corridor.points.size() / 10);
  PosePrior prior = prior_at(0.0, 1e-4);
  const double variance = 1.0 / register_in(corridor, prior).information(0, 0) - shared_m * shared_m;
  prior.is_measured = true;
  const double counted = 1.0 / register_in(corridor, prior).information(0, 0) - shared_m * shared_m;
  CHECK(variance > 0.025 * 0.025);
  CHECK(counted == Approx(variance + variance * variance / (required_m * required_m)).epsilon(0.1));
}

TEST_CASE("without a scan's equations there is no information, with more points there is more",
          "[degeneracy]") {
  CHECK(measurement_variance({}) > 0.0);
  const Corridor corridor(true);
  const NormalEquations all = plane_equations(corridor.map, corridor.points, {}, {});
  const std::vector<Eigen::Vector3f> few(corridor.points.begin(), corridor.points.begin() + 200);
  const NormalEquations some = plane_equations(corridor.map, few, {}, {});
  CHECK(all.H(0, 0) / measurement_variance(all) > 5.0 * some.H(0, 0) / measurement_variance(some));
  CHECK(all.H_normals.trace() > 0.0);
}
