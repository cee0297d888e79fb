#include "mapping/loops/pose_graph.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/SparseCholesky>

namespace nilio::mapping {

namespace {

using core::Matrix3;
using core::Matrix6;
using core::SE3;
using core::Vector3;
using core::Vector6;

/// Squared limits of an inlier: 99.9 % of 6, 2 and 3 degrees of freedom.
constexpr double kInlierSquare = 22.46;
constexpr double kPlanarSquare = 13.82;
constexpr double kPositionSquare = 16.27;
// Of the height of the frame of positions, per metre: positions may have no heights.
constexpr double kFrameHeightWeight = 1e-3;
constexpr double kGraduationStep = 4.0;
constexpr double kMinWeight = 0.25;
constexpr double kResolution = 1 << 23;
// Share of the cost: of the solution, and of those between two weights.
constexpr double kTolerance = 1e-9;
constexpr double kCoarseTolerance = 1e-3;
constexpr int kMaxSteps = 50;
constexpr int kMaxUphill = 4;
constexpr double kMinDamping = 1e-6;
constexpr double kMaxDamping = 1.0;
constexpr double kDampingStep = 0.1;

/// Error of a measured relative pose of two nodes, translation and rotation, in axes of the second one, and
/// its derivatives by changes of the nodes.
struct RelativeError {
  Vector6 error;
  Matrix6 by_a = Matrix6::Zero();
  Matrix6 by_b = Matrix6::Zero();
};

RelativeError relative_error(const SE3& measured, const SE3& a, const SE3& b) {
  const Matrix3 R_m = measured.rotation.conjugate().toRotationMatrix();
  const Matrix3 R_a = a.rotation.conjugate().toRotationMatrix();
  const Vector3 in_a = R_a * (b.translation - a.translation);
  Eigen::Quaterniond dq = measured.rotation.conjugate() * (a.rotation.conjugate() * b.rotation);
  if (dq.w() < 0.0) dq.coeffs() *= -1.0;
  const Matrix3 w = dq.w() * Matrix3::Identity();
  const Matrix3 v = core::skew(dq.vec());
  RelativeError result;
  result.error << R_m * (in_a - measured.translation), 2.0 * dq.vec();
  result.by_b.topLeftCorner<3, 3>() = R_m * R_a;
  result.by_b.bottomRightCorner<3, 3>() = w + v;
  result.by_a.topLeftCorner<3, 3>() = -result.by_b.topLeftCorner<3, 3>();
  result.by_a.topRightCorner<3, 3>() = R_m * core::skew(in_a);
  result.by_a.bottomRightCorner<3, 3>() = (v - w) * R_m;
  return result;
}

/// Least squares over the nodes but the first, the biases in units of their deviations, and the frame of
/// measured positions where there are some. Its measurements are the loops, then the positions.
class Graph {
 public:
  Graph(std::span<const SE3> odometry, std::span<const OdometryEdge> edges, std::span<const LoopEdge> loops,
        std::span<const MeasuredPosition> positions)
      : edges_(edges),
        loops_(loops),
        positions_(positions),
        weights_(loops.size() + positions.size(), 1.0),
        bias_column_(column_of(odometry.size())) {
    state_.nodes.assign(odometry.begin(), odometry.end());
    for (const SE3& node : odometry) ups_.push_back(node.rotation.conjugate() * Vector3::UnitZ());
  }

  [[nodiscard]] std::size_t measurements() const { return weights_.size(); }
  void set_weight(std::size_t measurement, double weight) { weights_[measurement] = weight; }

  /// Gauss-Newton until a step changes the cost by less than this share. From far away its steps first go up:
  /// damping, which would hold the shape of a long chain, whose bending is cheap, comes after some of those.
  void solve(double tolerance) {
    Equations equations = linearise();
    if (!std::exchange(is_analysed_, true)) solver_.analyzePattern(equations.H);
    State best = state_;
    double best_cost = equations.cost;
    double damping = 0.0;
    int uphill = 0;
    for (int step = 0; step < kMaxSteps && damping < kMaxDamping; ++step) {
      if (damping > 0.0) equations.H.diagonal() *= 1.0 + damping;
      solver_.factorize(equations.H);
      const Eigen::VectorXd change = solver_.solve(-equations.g);
      const bool is_solved = solver_.info() == Eigen::Success && change.allFinite();
      if (is_solved) {
        apply(change);
        equations = linearise();
      }
      const bool is_done = is_solved && std::abs(equations.cost - best_cost) <= tolerance * best_cost;
      if (is_solved && equations.cost < best_cost) {
        best = state_;
        best_cost = equations.cost;
        uphill = 0;
        damping *= kDampingStep;
      } else if (!is_solved || damping > 0.0 || ++uphill > kMaxUphill) {
        state_ = best;
        equations = linearise();
        uphill = 0;
        damping = std::max(damping / kDampingStep, kMinDamping);
      }
      if (is_done) break;
    }
    state_ = best;
  }

  /// Squared Mahalanobis norm of a measurement's residual, of a position as a share of the limit of loops.
  [[nodiscard]] double square(std::size_t i) const {
    if (i >= loops_.size()) {
      const MeasuredPosition& position = positions_[i - loops_.size()];
      const double limit = std::isfinite(position.deviation.z()) ? kPositionSquare : kPlanarSquare;
      return position_error(position, state_.nodes[position.node], state_.T_measured_map)
                 .error.squaredNorm() *
             (kInlierSquare / limit);
    }
    const LoopEdge& loop = loops_[i];
    const Vector6 error =
        relative_error(loop.T_reference_moving, state_.nodes[loop.reference], state_.nodes[loop.moving])
            .error;
    return error.dot(loop.information * error);
  }

  [[nodiscard]] const std::vector<SE3>& nodes() const { return state_.nodes; }
  /// In units of their deviations.
  [[nodiscard]] const Vector3& biases() const { return state_.biases; }
  [[nodiscard]] const SE3& T_measured_map() const { return state_.T_measured_map; }

 private:
  struct State {
    std::vector<SE3> nodes;
    Vector3 biases = Vector3::Zero();
    SE3 T_measured_map;
  };
  /// H change = -g.
  struct Equations {
    Eigen::SparseMatrix<double> H;  ///< lower triangle
    Eigen::VectorXd g;
    double cost = 0.0;
  };

  /// A node's change is its translation in axes of the graph, then its rotation in its own axes. No
  /// trigonometric function, whose bits the C library would make depend on the processor.
  void apply(const Eigen::VectorXd& change) {
    for (std::size_t i = 1; i < state_.nodes.size(); ++i) {
      move(state_.nodes[i], change.segment<3>(column_of(i)), change.segment<3>(column_of(i) + 3));
    }
    state_.biases += change.segment<3>(bias_column_);
    if (!positions_.empty())
      move(state_.T_measured_map, change.segment<3>(frame_column()),
           change[frame_column() + 3] * Vector3::UnitZ());
  }

  static void move(SE3& node, const Vector3& translation, const Vector3& rotation) {
    node.translation += translation;
    const Vector3 half = 0.5 * rotation;
    node.rotation = (node.rotation * Eigen::Quaterniond(1.0, half.x(), half.y(), half.z())).normalized();
  }

  static Eigen::Index column_of(std::size_t node) { return 6 * (static_cast<Eigen::Index>(node) - 1); }
  [[nodiscard]] Eigen::Index frame_column() const { return bias_column_ + 3; }

  /// Adds a block at the columns of two nodes, or of biases.
  template <class Block>
  void add_block(Eigen::Index row, Eigen::Index column, const Block& block) {
    for (Eigen::Index j = 0; j < block.cols(); ++j) {
      for (Eigen::Index i = row == column ? j : 0; i < block.rows(); ++i)
        triplets_.emplace_back(static_cast<int>(row + i), static_cast<int>(column + j), block(i, j));
    }
  }

  void add_edge(std::size_t a, std::size_t b, const RelativeError& r, const Matrix6& information,
                Equations& out) {
    const Matrix6 to_b = r.by_b.transpose() * information;
    out.cost += r.error.dot(information * r.error);
    out.g.segment<6>(column_of(b)) += to_b * r.error;
    add_block(column_of(b), column_of(b), Matrix6(to_b * r.by_b));
    if (a == 0) return;
    const Matrix6 to_a = r.by_a.transpose() * information;
    out.g.segment<6>(column_of(a)) += to_a * r.error;
    add_block(column_of(a), column_of(a), Matrix6(to_a * r.by_a));
    add_block(column_of(b), column_of(a), Matrix6(to_b * r.by_a));
  }

  void add_position(const MeasuredPosition& position, double weight, Equations& out) {
    const PositionError r = position_error(position, state_.nodes[position.node], state_.T_measured_map);
    const Eigen::Matrix<double, 4, 3> to_frame = weight * r.by_frame.transpose();
    out.cost += weight * r.error.squaredNorm();
    out.g.segment<4>(frame_column()) += to_frame * r.error;
    add_block(frame_column(), frame_column(), Eigen::Matrix4d(to_frame * r.by_frame));
    if (position.node == 0) return;
    const Eigen::Index column = column_of(position.node);
    const Eigen::Matrix<double, 6, 3> to_node = weight * r.by_node.transpose();
    out.g.segment<6>(column) += to_node * r.error;
    add_block(column, column, Matrix6(to_node * r.by_node));
    add_block(frame_column(), column, Eigen::Matrix<double, 4, 6>(to_frame * r.by_node));
  }

  Equations linearise() {
    const Eigen::Index bias_column = bias_column_;
    const Eigen::Index size = bias_column + 3 + (positions_.empty() ? 0 : 4);
    Equations out;
    out.g = Eigen::VectorXd::Zero(size);
    triplets_.clear();
    for (std::size_t i = 0; i < edges_.size(); ++i) {
      const OdometryEdge& edge = edges_[i];
      const BiasJacobian by_bias = bias_jacobian(edge) * bias_deviation().asDiagonal();
      Vector6 variance = walk_variance(edge);
      // Positions show how the biases vary along the drive.
      if (!positions_.empty()) variance += by_bias.cwiseAbs2().rowwise().sum();
      const Vector6 weights = variance.cwiseInverse();
      RelativeError r = relative_error(edge.T_from_to, state_.nodes[i], state_.nodes[i + 1]);
      r.error += by_bias * state_.biases;
      add_edge(i, i + 1, r, weights.asDiagonal(), out);
      const Eigen::Matrix<double, 3, 6> to_bias = by_bias.transpose() * weights.asDiagonal();
      out.g.segment<3>(bias_column) += to_bias * r.error;
      add_block(bias_column, bias_column, Matrix3(to_bias * by_bias));
      add_block(bias_column, column_of(i + 1), BiasBlock(to_bias * r.by_b));
      if (i > 0) add_block(bias_column, column_of(i), BiasBlock(to_bias * r.by_a));
      // The node's axis that odometry has for vertical is vertical.
      const Matrix3 R = state_.nodes[i + 1].rotation.toRotationMatrix() / kTiltDeviation;
      const Eigen::Vector2d tilt = (R * ups_[i + 1]).head<2>();
      const Eigen::Matrix<double, 2, 3> by_rotation = -(R * core::skew(ups_[i + 1])).topRows<2>();
      const Eigen::Index rotation = column_of(i + 1) + 3;
      out.cost += tilt.squaredNorm();
      out.g.segment<3>(rotation) += by_rotation.transpose() * tilt;
      add_block(rotation, rotation, Matrix3(by_rotation.transpose() * by_rotation));
    }
    out.cost += state_.biases.squaredNorm();
    out.g.segment<3>(bias_column) += state_.biases;
    add_block(bias_column, bias_column, Matrix3(Matrix3::Identity()));
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      const LoopEdge& loop = loops_[i];
      const RelativeError r =
          relative_error(loop.T_reference_moving, state_.nodes[loop.reference], state_.nodes[loop.moving]);
      add_edge(loop.reference, loop.moving, r, weights_[i] * loop.information, out);
    }
    for (std::size_t i = 0; i < positions_.size(); ++i)
      add_position(positions_[i], weights_[loops_.size() + i], out);
    if (!positions_.empty()) {
      const double height = state_.T_measured_map.translation.z() * kFrameHeightWeight;
      out.cost += height * height;
      out.g[frame_column() + 2] += kFrameHeightWeight * height;
      add_block(frame_column() + 2, frame_column() + 2,
                Eigen::Matrix<double, 1, 1>(kFrameHeightWeight * kFrameHeightWeight));
    }
    out.H.resize(size, size);
    out.H.setFromTriplets(triplets_.begin(), triplets_.end());
    return out;
  }

  using BiasBlock = Eigen::Matrix<double, 3, 6>;

  std::span<const OdometryEdge> edges_;
  std::span<const LoopEdge> loops_;
  std::span<const MeasuredPosition> positions_;
  std::vector<double> weights_;  ///< of the measurements
  Eigen::Index bias_column_;
  std::vector<Vector3> ups_;  ///< the odometry's vertical, in axes of the nodes
  State state_;
  std::vector<Eigen::Triplet<double>> triplets_;  // refilled
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver_;
  bool is_analysed_ = false;
};

double rounded(double value) { return std::round(value * kResolution) / kResolution; }

SE3 rounded(const SE3& pose) {
  const auto round = [](double value) { return rounded(value); };
  return {Eigen::Quaterniond(pose.rotation.coeffs().unaryExpr(round).eval()).normalized(),
          pose.translation.unaryExpr(round)};
}

}  // namespace

PositionError position_error(const MeasuredPosition& measured, const SE3& node, const SE3& T_measured_map) {
  const Vector3 in_map = node * measured.point;
  const Matrix3 W = measured.deviation.cwiseInverse().asDiagonal();
  const Matrix3 WR = W * T_measured_map.rotation.toRotationMatrix();
  PositionError result;
  result.error = W * (T_measured_map * in_map - measured.position);
  result.by_node << WR, -WR * node.rotation.toRotationMatrix() * core::skew(measured.point);
  result.by_frame << W, WR * Vector3::UnitZ().cross(in_map);
  return result;
}

GraphSolution optimise(std::span<const SE3> odometry, std::span<const OdometryEdge> edges,
                       std::span<const LoopEdge> loops, std::span<const MeasuredPosition> positions) {
  GraphSolution solution;
  solution.poses.assign(odometry.begin(), odometry.end());
  solution.is_inlier.assign(loops.size(), true);
  solution.is_position_inlier.assign(positions.size(), true);
  if (loops.empty() && positions.empty()) return solution;
  Graph graph(odometry, edges, loops, positions);
  graph.solve(kCoarseTolerance);
  double largest = 0.0;
  for (std::size_t i = 0; i < graph.measurements(); ++i) largest = std::max(largest, graph.square(i));
  // Weights of Geman-McClure, from a convex cost to the kernel itself.
  std::vector<double> weights(graph.measurements(), 1.0);
  for (double mu = 2.0 * largest / kInlierSquare; largest > kInlierSquare; mu /= kGraduationStep) {
    mu = std::max(mu, 1.0);
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const double share = mu * kInlierSquare / (graph.square(i) + mu * kInlierSquare);
      weights[i] = share * share;
      graph.set_weight(i, weights[i]);
    }
    graph.solve(kCoarseTolerance);
    if (mu <= 1.0) break;
  }
  if (largest > kInlierSquare) {
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const bool is_inlier = weights[i] > kMinWeight;
      if (i < loops.size())
        solution.is_inlier[i] = is_inlier;
      else
        solution.is_position_inlier[i - loops.size()] = is_inlier;
      graph.set_weight(i, is_inlier ? 1.0 : 0.0);
    }
  }
  graph.solve(kTolerance);
  solution.biases =
      graph.biases().unaryExpr([](double value) { return rounded(value); }).cwiseProduct(bias_deviation());
  for (std::size_t i = 0; i < solution.poses.size(); ++i) solution.poses[i] = rounded(graph.nodes()[i]);
  solution.T_measured_map = rounded(graph.T_measured_map());
  return solution;
}

double cycle_error(const LoopEdge& a, const LoopEdge& b, std::span<const OdometryEdge> edges) {
  // b's loop, predicted from a's: back to the reference of b, and on to its moving node.
  const auto between = [&](std::size_t from, std::size_t to) {
    const std::size_t first = std::min(from, to);
    const Chain part = chain(edges.subspan(first, std::max(from, to) - first));
    if (from <= to) return std::pair{part.T_from_to, part.covariance()};
    const Matrix6 Ad = core::adjoint(part.T_from_to);
    return std::pair{part.T_from_to.inverse(), Matrix6(Ad * part.covariance() * Ad.transpose())};
  };
  const auto [T_b_a, before] = between(b.reference, a.reference);
  const auto [T_a_b, after] = between(a.moving, b.moving);
  const SE3 predicted = T_b_a * a.T_reference_moving * T_a_b;
  const Vector6 error = core::se3_log(b.T_reference_moving.inverse() * predicted);
  const Matrix6 to_end = core::adjoint((a.T_reference_moving * T_a_b).inverse());
  const Matrix6 to_moving = core::adjoint(T_a_b.inverse());
  const Matrix6 covariance = to_end * before * to_end.transpose() +
                             to_moving * core::inverse_ldlt(a.information) * to_moving.transpose() + after +
                             core::inverse_ldlt(b.information);
  return error.dot(core::solve_ldlt(covariance, error));
}

}  // namespace nilio::mapping
