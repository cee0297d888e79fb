#include "mapping/loops/pose_graph.hpp"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <iostream>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::mapping;
using core::SE3;

struct Drive {
  std::vector<SE3> truth;
  std::vector<SE3> odometry;
  std::vector<OdometryEdge> edges;
  Eigen::Vector3d biases = bias_deviation();
};

/// Circles of 40 nodes with edges of 25 m; errors as the drift model has them.
Drive circles(std::size_t nodes, std::uint32_t seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Drive drive;
  drive.truth.emplace_back();
  drive.odometry.emplace_back();
  Eigen::Vector3d& bias = drive.biases;
  for (double& value : bias) value *= normal(random);
  OdometryEdge edge;
  edge.T_from_to = {core::so3_exp({0.0, 0.0, 0.157}), {25.0, 0.0, 0.0}};
  edge.path_m = 25.0;
  for (std::size_t i = 1; i < nodes; ++i) {
    drive.truth.push_back(drive.truth.back() * edge.T_from_to);
    core::Vector6 error = walk_variance(edge).cwiseSqrt();
    for (double& value : error) value *= normal(random);
    error.segment<2>(3).setZero();
    error += bias_jacobian(edge) * bias;
    OdometryEdge measured = edge;
    measured.T_from_to = edge.T_from_to * core::se3_exp(error);
    // Roll and pitch are those of gravity.
    const SE3 next = drive.odometry.back() * measured.T_from_to;
    drive.odometry.push_back(next);
    drive.edges.push_back(measured);
  }
  return drive;
}

LoopEdge loop_between(const Drive& drive, std::size_t reference, std::size_t moving, std::mt19937& random,
                      double noise = 1.0) {
  std::normal_distribution<double> normal;
  LoopEdge loop{reference, moving, drive.truth[reference].inverse() * drive.truth[moving], {}};
  core::Vector6 sigma;
  sigma << 0.05, 0.05, 0.05, 0.003, 0.003, 0.003;
  core::Vector6 error = sigma;
  for (double& value : error) value *= noise * normal(random);
  loop.T_reference_moving = loop.T_reference_moving * core::se3_exp(error);
  loop.information = sigma.cwiseAbs2().cwiseInverse().asDiagonal();
  return loop;
}

double rms(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  double sum = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i)
    sum += (poses[i].translation - truth[i].translation).squaredNorm();
  return std::sqrt(sum / static_cast<double>(poses.size()));
}

}  // namespace

TEST_CASE("loops take the drift out", "[pose_graph]") {
  for (const std::uint32_t seed : {11U, 12U, 13U}) {
    std::mt19937 random(seed);
    const Drive drive = circles(100, seed);
    std::vector<LoopEdge> loops;
    for (std::size_t i = 40; i < 100; i += 6) loops.push_back(loop_between(drive, i - 40, i, random));
    const GraphSolution solution = optimise(drive.odometry, drive.edges, loops);
    const double before = rms(drive.odometry, drive.truth);
    const double after = rms(solution.poses, drive.truth);
    INFO("seed " << seed << ": " << before << " to " << after << " m");
    CHECK(after < 0.7 * before);
    CHECK(std::abs(solution.biases[1] - drive.biases[1]) < 0.3 * bias_deviation()[1]);
    CHECK(std::count(solution.is_inlier.begin(), solution.is_inlier.end(), true) == 10);
    // The first node keeps its pose.
    CHECK(solution.poses.front().translation.norm() == 0.0);
  }
}

TEST_CASE("false loops among true ones are taken out", "[pose_graph]") {
  std::mt19937 random(5);
  const Drive drive = circles(120, 5);
  std::vector<LoopEdge> loops;
  for (std::size_t i = 40; i < 120; i += 5) loops.push_back(loop_between(drive, i - 40, i, random));
  const std::size_t correct = loops.size();
  for (const auto& [reference, moving] : {std::pair{3, 60}, std::pair{10, 90}, std::pair{22, 101}}) {
    LoopEdge loop =
        loop_between(drive, static_cast<std::size_t>(reference), static_cast<std::size_t>(moving), random);
    loop.T_reference_moving = SE3{core::so3_exp({0.0, 0.0, 0.3}), {2.0, 3.0, 0.0}};
    loops.push_back(loop);
  }
  const GraphSolution solution = optimise(drive.odometry, drive.edges, loops);
  for (std::size_t i = 0; i < loops.size(); ++i) CHECK(solution.is_inlier[i] == (i < correct));
  CHECK(rms(solution.poses, drive.truth) < 1.0);
}

TEST_CASE(
    "a drive that has drifted by more than a hundred metres is solved, with false loops among the true ones",
    "[pose_graph]") {
  std::mt19937 random(9);
  const Drive drive = circles(600, 9);
  std::vector<LoopEdge> loops;
  for (std::size_t i = 100; i < 600; i += 3) loops.push_back(loop_between(drive, i - 80, i, random, 0.5));
  const std::size_t correct = loops.size();
  for (std::size_t i = 100; i < 600; i += 25) {
    loops.push_back(loop_between(drive, i - 63, i, random));
    loops.back().T_reference_moving = SE3{};
  }
  const GraphSolution solution = optimise(drive.odometry, drive.edges, loops);
  INFO(rms(drive.odometry, drive.truth) << " to " << rms(solution.poses, drive.truth) << " m");
  CHECK(rms(drive.odometry, drive.truth) > 50.0);
  CHECK(rms(solution.poses, drive.truth) < 1.0);
  for (std::size_t i = 0; i < loops.size(); ++i) CHECK(solution.is_inlier[i] == (i < correct));
}

TEST_CASE("without loops the poses are those of the odometry, and the same input gives the same bits",
          "[pose_graph]") {
  std::mt19937 random(6);
  const Drive drive = circles(60, 6);
  const GraphSolution alone = optimise(drive.odometry, drive.edges, {});
  CHECK(rms(alone.poses, drive.odometry) == 0.0);
  CHECK(optimise(std::vector<SE3>{SE3{}}, {}, {}).poses.size() == 1);
  const std::vector<LoopEdge> loops{loop_between(drive, 0, 40, random), loop_between(drive, 10, 50, random)};
  const GraphSolution a = optimise(drive.odometry, drive.edges, loops);
  const GraphSolution b = optimise(drive.odometry, drive.edges, loops);
  for (std::size_t i = 0; i < a.poses.size(); ++i)
    CHECK(std::memcmp(a.poses[i].translation.data(), b.poses[i].translation.data(), 3 * sizeof(double)) == 0);
}

TEST_CASE("the covariance of a chain is that of drawn drives", "[drift_model]") {
  // Mean squared error over its covariance, of chains along a quarter of the circle.
  double sum = 0.0;
  constexpr int kDrives = 300;
  for (std::uint32_t seed = 1; seed <= kDrives; ++seed) {
    const Drive drive = circles(11, seed);
    const core::SE3 T = drive.truth.front().inverse() * drive.truth.back();
    const core::Vector6 error = core::se3_log(T.inverse() * chain_transform(drive.edges));
    sum += error.dot(chain_covariance(drive.edges).ldlt().solve(error));
  }
  // Roll and pitch have no errors here: four of six components.
  CHECK(sum / kDrives > 0.8 * 4.0);
  CHECK(sum / kDrives < 1.2 * 4.0);
}

TEST_CASE("two loops of one drift agree, a shifted one does not", "[pose_graph]") {
  std::mt19937 random(8);
  const Drive drive = circles(80, 8);
  const LoopEdge a = loop_between(drive, 2, 42, random);
  const LoopEdge b = loop_between(drive, 4, 44, random);
  CHECK(cycle_error(a, b, drive.edges) < 16.81);
  CHECK(cycle_error(b, a, drive.edges) < 16.81);
  LoopEdge shifted = b;
  shifted.T_reference_moving.translation.y() += 8.0;
  CHECK(cycle_error(a, shifted, drive.edges) > 100.0);
}

TEST_CASE("time of a graph of 1000 places with 300 loops", "[.][timing]") {
  std::mt19937 random(9);
  const Drive drive = circles(1000, 9);
  std::vector<LoopEdge> loops;
  for (std::size_t i = 100; i < 1000; i += 3) loops.push_back(loop_between(drive, i - 80, i, random, 0.5));
  const auto timed = [&](const char* name) {
    const auto begin = std::chrono::steady_clock::now();
    const GraphSolution solution = optimise(drive.odometry, drive.edges, loops);
    const std::chrono::duration<double, std::milli> ms = std::chrono::steady_clock::now() - begin;
    std::cout << name << ": " << ms.count() << " ms, " << rms(drive.odometry, drive.truth) << " to "
              << rms(solution.poses, drive.truth) << " m\n";
  };
  timed("300 true loops");
  std::uniform_int_distribution<std::size_t> node(0, 999);
  for (int i = 0; i < 30; ++i) {
    const std::size_t a = node(random);
    const std::size_t b = node(random);
    if (a == b) continue;
    loops.push_back(loop_between(drive, std::min(a, b), std::max(a, b), random));
    loops.back().T_reference_moving = SE3{};
  }
  timed("and 30 false ones");
}
