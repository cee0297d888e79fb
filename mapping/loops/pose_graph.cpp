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

/// Squared limit of an inlier: 99.9 % of 6 degrees of freedom.
constexpr double kInlierSquare = 22.46;
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

/// Least squares over the nodes but the first, and the biases in units of their deviations.
class Graph {
 public:
  Graph(std::span<const SE3> odometry, std::span<const OdometryEdge> edges, std::span<const LoopEdge> loops)
      : edges_(edges), loops_(loops), weights_(loops.size(), 1.0) {
    state_.nodes.assign(odometry.begin(), odometry.end());
    for (const SE3& node : odometry) ups_.push_back(node.rotation.conjugate() * Vector3::UnitZ());
  }

  void set_weight(std::size_t loop, double weight) { weights_[loop] = weight; }

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

  /// Squared Mahalanobis norm of a loop's residual.
  [[nodiscard]] double square(std::size_t i) const {
    const LoopEdge& loop = loops_[i];
    const Vector6 error =
        relative_error(loop.T_reference_moving, state_.nodes[loop.reference], state_.nodes[loop.moving])
            .error;
    return error.dot(loop.information * error);
  }

  [[nodiscard]] const std::vector<SE3>& nodes() const { return state_.nodes; }
  /// In units of their deviations.
  [[nodiscard]] const Vector3& biases() const { return state_.biases; }

 private:
  struct State {
    std::vector<SE3> nodes;
    Vector3 biases = Vector3::Zero();
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
      SE3& node = state_.nodes[i];
      node.translation += change.segment<3>(column_of(i));
      const Vector3 half = 0.5 * change.segment<3>(column_of(i) + 3);
      node.rotation = (node.rotation * Eigen::Quaterniond(1.0, half.x(), half.y(), half.z())).normalized();
    }
    state_.biases += change.tail<3>();
  }

  static Eigen::Index column_of(std::size_t node) { return 6 * (static_cast<Eigen::Index>(node) - 1); }

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

  Equations linearise() {
    const Eigen::Index size = column_of(state_.nodes.size()) + 3;
    const Eigen::Index bias_column = size - 3;
    Equations out;
    out.g = Eigen::VectorXd::Zero(size);
    triplets_.clear();
    for (std::size_t i = 0; i < edges_.size(); ++i) {
      const OdometryEdge& edge = edges_[i];
      const Vector6 weights = walk_variance(edge).cwiseInverse();
      const BiasJacobian by_bias = bias_jacobian(edge) * bias_deviation().asDiagonal();
      RelativeError r = relative_error(edge.T_from_to, state_.nodes[i], state_.nodes[i + 1]);
      r.error += by_bias * state_.biases;
      add_edge(i, i + 1, r, weights.asDiagonal(), out);
      const Eigen::Matrix<double, 3, 6> to_bias = by_bias.transpose() * weights.asDiagonal();
      out.g.tail<3>() += to_bias * r.error;
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
    out.g.tail<3>() += state_.biases;
    add_block(bias_column, bias_column, Matrix3(Matrix3::Identity()));
    for (std::size_t i = 0; i < loops_.size(); ++i) {
      const LoopEdge& loop = loops_[i];
      const RelativeError r =
          relative_error(loop.T_reference_moving, state_.nodes[loop.reference], state_.nodes[loop.moving]);
      add_edge(loop.reference, loop.moving, r, weights_[i] * loop.information, out);
    }
    out.H.resize(size, size);
    out.H.setFromTriplets(triplets_.begin(), triplets_.end());
    return out;
  }

  using BiasBlock = Eigen::Matrix<double, 3, 6>;

  std::span<const OdometryEdge> edges_;
  std::span<const LoopEdge> loops_;
  std::vector<double> weights_;
  std::vector<Vector3> ups_;  ///< the odometry's vertical, in axes of the nodes
  State state_;
  std::vector<Eigen::Triplet<double>> triplets_;  // refilled
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver_;
  bool is_analysed_ = false;
};

double rounded(double value) { return std::round(value * kResolution) / kResolution; }

}  // namespace

GraphSolution optimise(std::span<const SE3> odometry, std::span<const OdometryEdge> edges,
                       std::span<const LoopEdge> loops) {
  GraphSolution solution;
  solution.poses.assign(odometry.begin(), odometry.end());
  solution.is_inlier.assign(loops.size(), true);
  if (loops.empty()) return solution;
  Graph graph(odometry, edges, loops);
  graph.solve(kCoarseTolerance);
  double largest = 0.0;
  for (std::size_t i = 0; i < loops.size(); ++i) largest = std::max(largest, graph.square(i));
  // Weights of Geman-McClure, from a convex cost to the kernel itself.
  std::vector<double> weights(loops.size(), 1.0);
  for (double mu = 2.0 * largest / kInlierSquare; largest > kInlierSquare; mu /= kGraduationStep) {
    mu = std::max(mu, 1.0);
    for (std::size_t i = 0; i < loops.size(); ++i) {
      const double share = mu * kInlierSquare / (graph.square(i) + mu * kInlierSquare);
      weights[i] = share * share;
      graph.set_weight(i, weights[i]);
    }
    graph.solve(kCoarseTolerance);
    if (mu <= 1.0) break;
  }
  if (largest > kInlierSquare) {
    for (std::size_t i = 0; i < loops.size(); ++i) {
      solution.is_inlier[i] = weights[i] > kMinWeight;
      graph.set_weight(i, solution.is_inlier[i] ? 1.0 : 0.0);
    }
  }
  graph.solve(kTolerance);
  solution.biases = graph.biases().unaryExpr(&rounded).cwiseProduct(bias_deviation());
  for (std::size_t i = 0; i < solution.poses.size(); ++i) {
    const SE3& node = graph.nodes()[i];
    SE3& pose = solution.poses[i];
    pose.translation = node.translation.unaryExpr(&rounded);
    pose.rotation = Eigen::Quaterniond(node.rotation.coeffs().unaryExpr(&rounded).eval()).normalized();
  }
  return solution;
}

double cycle_error(const LoopEdge& a, const LoopEdge& b, std::span<const OdometryEdge> edges) {
  // b's loop, predicted from a's: back to the reference of b, and on to its moving node.
  const auto chain = [&](std::size_t from, std::size_t to) {
    const std::size_t first = std::min(from, to);
    const auto part = edges.subspan(first, std::max(from, to) - first);
    const SE3 T = chain_transform(part);
    const Matrix6 covariance = chain_covariance(part);
    if (from <= to) return std::pair{T, covariance};
    const Matrix6 Ad = core::adjoint(T);
    return std::pair{T.inverse(), Matrix6(Ad * covariance * Ad.transpose())};
  };
  const auto [T_b_a, before] = chain(b.reference, a.reference);
  const auto [T_a_b, after] = chain(a.moving, b.moving);
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
