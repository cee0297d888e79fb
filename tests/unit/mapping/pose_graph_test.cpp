#include "mapping/loops/pose_graph.hpp"

#include <algorithm>
#include <chrono>
#include <cstring>
#include <iostream>
#include <limits>
#include <random>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
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

TEST_CASE("the derivatives of a measured position are those of finite differences", "[pose_graph]") {
  MeasuredPosition measured;
  measured.point = {-0.4, 0.3, 1.9};
  measured.position = {103.0, -42.0, 6.0};
  measured.deviation = {1.5, 1.5, 4.0};
  const SE3 node{core::so3_exp({0.1, -0.2, 1.2}), {100.0, -40.0, 3.0}};
  const SE3 frame{core::so3_exp({0.0, 0.0, 0.3}), {5.0, -7.0, 2.0}};
  const PositionError at = position_error(measured, node, frame);
  constexpr double kStep = 1e-6;
  for (int i = 0; i < 6; ++i) {
    core::Vector6 change = core::Vector6::Zero();
    change[i] = kStep;
    const auto error = [&](double sign) {
      const SE3 moved{node.rotation * core::so3_exp(sign * change.tail<3>()),
                      node.translation + sign * change.head<3>()};
      return position_error(measured, moved, frame).error;
    };
    CHECK(((error(1.0) - error(-1.0)) / (2.0 * kStep) - at.by_node.col(i)).norm() < 1e-6);
  }
  for (int i = 0; i < 4; ++i) {
    Eigen::Vector4d change = Eigen::Vector4d::Zero();
    change[i] = kStep;
    const auto error = [&](double sign) {
      const SE3 moved{frame.rotation * core::so3_exp({0.0, 0.0, sign * change[3]}),
                      frame.translation + sign * change.head<3>()};
      return position_error(measured, node, moved).error;
    };
    CHECK(((error(1.0) - error(-1.0)) / (2.0 * kStep) - at.by_frame.col(i)).norm() < 1e-6);
  }
  measured.deviation.z() = std::numeric_limits<double>::infinity();
  CHECK(position_error(measured, node, frame).error.z() == 0.0);
}

namespace {

/// Positions of an antenna at the true nodes, in a frame that is turned and shifted; errors of a receiver
/// that are correlated over ten nodes.
struct Receiver {
  SE3 T_frame_truth{core::so3_exp({0.0, 0.0, 0.4}), {30.0, -20.0, 5.0}};
  core::Vector3 antenna{-0.5, 0.2, 1.5};
  std::vector<MeasuredPosition> positions;
};

Receiver receive(const Drive& drive, std::uint32_t seed, bool has_height = true) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  Receiver receiver;
  core::Vector3 slow = core::Vector3::Zero();
  for (std::size_t i = 0; i < drive.truth.size(); ++i) {
    const auto draw = [&] { return core::Vector3(normal(random), normal(random), 2.0 * normal(random)); };
    if (i % 10 == 0) slow = draw();
    MeasuredPosition position;
    position.node = i;
    position.point = receiver.antenna;
    position.position =
        receiver.T_frame_truth * (drive.truth[i] * receiver.antenna) + 0.7 * slow + 0.7 * draw();
    position.deviation = {1.0, 1.0, has_height ? 2.0 : std::numeric_limits<double>::infinity()};
    receiver.positions.push_back(position);
  }
  return receiver;
}

/// Horizontal error of the map in the frame of the positions.
double error_in_frame(const GraphSolution& solution, const Drive& drive, const Receiver& receiver) {
  double sum = 0.0;
  for (std::size_t i = 0; i < drive.truth.size(); ++i)
    sum += (solution.T_measured_map * solution.poses[i].translation -
            receiver.T_frame_truth * drive.truth[i].translation)
               .head<2>()
               .squaredNorm();
  return std::sqrt(sum / static_cast<double>(drive.truth.size()));
}

/// Residual of the odometry after the best horizontal alignment with the truth.
double aligned_rms(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  Eigen::Matrix2Xd a(2, poses.size());
  Eigen::Matrix2Xd b(2, poses.size());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    a.col(static_cast<Eigen::Index>(i)) = poses[i].translation.head<2>();
    b.col(static_cast<Eigen::Index>(i)) = truth[i].translation.head<2>();
  }
  const Eigen::Matrix3d T = Eigen::umeyama(a, b, false);
  return std::sqrt(((T.topLeftCorner<2, 2>() * a).colwise() + T.topRightCorner<2, 1>() - b).squaredNorm() /
                   static_cast<double>(poses.size()));
}

}  // namespace

TEST_CASE("positions take the drift out and place the map in their frame", "[pose_graph]") {
  for (const std::uint32_t seed : {31U, 32U, 33U}) {
    const Drive drive = circles(100, seed);
    for (const bool has_height : {true, false}) {
      const Receiver receiver = receive(drive, seed, has_height);
      const GraphSolution solution = optimise(drive.odometry, drive.edges, {}, receiver.positions);
      const double before = aligned_rms(drive.odometry, drive.truth);
      const double after = error_in_frame(solution, drive, receiver);
      INFO("seed " << seed << ": " << before << " to " << after << " m");
      CHECK(after < 0.5 * before);
      CHECK(after < 1.0);
      CHECK(std::abs(solution.biases[1] - drive.biases[1]) < 0.3 * bias_deviation()[1]);
      CHECK(std::count(solution.is_position_inlier.begin(), solution.is_position_inlier.end(), true) >= 98);
      CHECK(solution.T_measured_map.rotation.angularDistance(receiver.T_frame_truth.rotation) < 0.01);
      // Height, too, where there is one.
      const double height = (solution.T_measured_map * solution.poses.back().translation -
                             receiver.T_frame_truth * drive.truth.back().translation)
                                .z();
      if (has_height) CHECK(std::abs(height) < 2.0);
    }
  }
}

TEST_CASE("jumps and reflections of positions do not bend the map", "[pose_graph]") {
  for (const std::uint32_t seed : {41U, 42U, 43U}) {
    const Drive drive = circles(120, seed);
    const Receiver clean = receive(drive, seed);
    Receiver bad = clean;
    std::mt19937 random(seed);
    std::vector<std::size_t> wrong;
    for (std::size_t i = 0; i < bad.positions.size(); ++i) {
      // A street of 250 m between high walls, a jump of three places, single ones.
      core::Vector3 error = core::Vector3::Zero();
      if (i >= 60 && i < 70) error = {12.0, -9.0, 0.0};
      if (i >= 20 && i < 23) error = {0.0, 30.0, 10.0};
      if (i % 17 == 5) error = {-40.0, 25.0, -30.0};
      if (error.isZero()) continue;
      bad.positions[i].position += error;
      wrong.push_back(i);
    }
    const GraphSolution with = optimise(drive.odometry, drive.edges, {}, bad.positions);
    const double error = error_in_frame(with, drive, clean);
    INFO("seed " << seed << ": " << aligned_rms(drive.odometry, drive.truth) << " to " << error << " m");
    CHECK(error < 1.2);
    for (const std::size_t i : wrong) CHECK_FALSE(with.is_position_inlier[i]);
    CHECK(std::count(with.is_position_inlier.begin(), with.is_position_inlier.end(), true) > 90);
  }
}

TEST_CASE("loops and positions are solved together, and a wrong antenna is no worse than its error",
          "[pose_graph]") {
  std::mt19937 random(51);
  const Drive drive = circles(100, 51);
  std::vector<LoopEdge> loops;
  for (std::size_t i = 40; i < 100; i += 6) loops.push_back(loop_between(drive, i - 40, i, random));
  loops.push_back(loop_between(drive, 10, 70, random));
  loops.back().T_reference_moving = SE3{core::so3_exp({0.0, 0.0, 0.3}), {2.0, 3.0, 0.0}};
  Receiver receiver = receive(drive, 51);
  const GraphSolution both = optimise(drive.odometry, drive.edges, loops, receiver.positions);
  CHECK_FALSE(both.is_inlier.back());
  CHECK(std::count(both.is_inlier.begin(), both.is_inlier.end(), true) == 10);
  const double right = error_in_frame(both, drive, receiver);
  CHECK(right < 1.0);
  for (MeasuredPosition& position : receiver.positions) position.point = {1.5, 0.2, 1.5};
  const GraphSolution wrong = optimise(drive.odometry, drive.edges, loops, receiver.positions);
  CHECK(error_in_frame(wrong, drive, receiver) < right + 2.0);
  CHECK(wrong.is_position_inlier == std::vector<bool>(100, true));
  // The same input, the same bits.
  const GraphSolution again = optimise(drive.odometry, drive.edges, loops, receiver.positions);
  for (std::size_t i = 0; i < wrong.poses.size(); ++i)
    CHECK(std::memcmp(again.poses[i].translation.data(), wrong.poses[i].translation.data(), 24) == 0);
}

TEST_CASE("the covariance of a chain is that of drawn drives", "[drift_model]") {
  // Mean squared error over its covariance, of chains along a quarter of the circle.
  double sum = 0.0;
  double distances = 0.0;
  constexpr int kDrives = 300;
  for (std::uint32_t seed = 1; seed <= kDrives; ++seed) {
    const Drive drive = circles(11, seed);
    const core::SE3 T = drive.truth.front().inverse() * drive.truth.back();
    const Chain whole = chain(drive.edges);
    const core::Vector6 error = core::se3_log(T.inverse() * whole.T_from_to);
    sum += error.dot(whole.covariance().ldlt().solve(error));
    distances += chain_distance(drive.edges, T, core::Matrix6::Zero());
  }
  // Short chains are linear in the biases.
  CHECK(distances == Approx(sum).epsilon(0.02));
  // Roll and pitch have no errors here: four of six components.
  CHECK(sum / kDrives > 0.8 * 4.0);
  CHECK(sum / kDrives < 1.2 * 4.0);
}

TEST_CASE("a heading that drifts far by a steady bias is no contradiction", "[drift_model]") {
  OdometryEdge edge;
  edge.T_from_to = {core::so3_exp({0.0, 0.0, 0.0157}), {25.0, 0.0, 0.0}};
  edge.path_m = 25.0;
  SE3 truth;
  for (int i = 0; i < 200; ++i) truth = truth * edge.T_from_to;
  // 25 degrees in 5 km.
  const Eigen::Vector3d biases{0.0, 2.0 * bias_deviation()[1], 0.0};
  edge.T_from_to = edge.T_from_to * core::se3_exp(bias_jacobian(edge) * biases);
  const std::vector<OdometryEdge> edges(200, edge);
  core::Vector6 variance;
  variance << Eigen::Vector3d::Constant(0.01), Eigen::Vector3d::Constant(1e-6);
  const core::Matrix6 covariance = variance.asDiagonal();
  const Chain whole = chain(edges);
  const core::Vector6 error = core::se3_log(truth.inverse() * whole.T_from_to);
  CHECK(error[5] > 0.4);
  // Two deviations of the bias explain it, which a model linear in the bias does not see.
  CHECK(chain_distance(edges, truth, covariance) < 4.2);
  CHECK(error.dot((whole.covariance() + covariance).ldlt().solve(error)) > 20.0);
  // No bias explains a place beside it, or another heading.
  CHECK(chain_distance(edges, truth * SE3{core::so3_exp({0.0, 0.0, 0.3}), {}}, covariance) > 22.46);
  CHECK(chain_distance(edges, truth * SE3{{}, {0.0, 0.0, 20.0}}, covariance) > 22.46);
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
