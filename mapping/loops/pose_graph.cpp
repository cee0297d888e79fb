#include "mapping/loops/pose_graph.hpp"

#include "core/src/linear_algebra.hpp"

#include <algorithm>
#include <array>
#include <ceres/ceres.h>
#include <cmath>

namespace nilio::mapping {

namespace {

using core::Matrix6;
using core::SE3;
using core::Vector3;
using core::Vector6;

/// Squared limit of an inlier: 99.9 % of 6 degrees of freedom.
constexpr double kInlierSquare = 22.46;
constexpr double kGraduationStep = 4.0;
constexpr double kMinWeight = 0.25;
constexpr double kResolution = 1 << 23;

/// Unit quaternions x y z w with a retraction without trigonometric functions, whose bits the C library would
/// make depend on the processor.
struct QuaternionRetraction {
  template <class T>
  bool Plus(const T* x, const T* delta, T* result) const {
    const Eigen::Map<const Eigen::Quaternion<T>> q(x);
    const Eigen::Quaternion<T> step(T(1.0), T(0.5) * delta[0], T(0.5) * delta[1], T(0.5) * delta[2]);
    Eigen::Map<Eigen::Quaternion<T>> sum(result);
    sum = q * step.normalized();
    return true;
  }
  template <class T>
  bool Minus(const T* y, const T* x, T* result) const {
    const Eigen::Quaternion<T> d =
        Eigen::Map<const Eigen::Quaternion<T>>(x).conjugate() * Eigen::Map<const Eigen::Quaternion<T>>(y);
    for (int i = 0; i < 3; ++i) result[i] = T(2.0) * d.vec()[i] / d.w();
    return true;
  }
};

/// Error on the right of the measured relative pose of two nodes.
template <class T>
Eigen::Matrix<T, 6, 1> relative_error(const SE3& measured, const T* qa, const T* ta, const T* qb,
                                      const T* tb) {
  using Quaternion = Eigen::Quaternion<T>;
  using Vector = Eigen::Matrix<T, 3, 1>;
  const Eigen::Map<const Quaternion> q_a(qa);
  const Eigen::Map<const Quaternion> q_b(qb);
  const Vector d = Eigen::Map<const Vector>(tb) - Eigen::Map<const Vector>(ta);
  const Quaternion q_m = measured.rotation.cast<T>();
  const Vector in_a = q_a.conjugate() * d;
  const Quaternion dq = q_m.conjugate() * (q_a.conjugate() * q_b);
  Eigen::Matrix<T, 6, 1> error;
  error << q_m.conjugate() * Vector(in_a - measured.translation.cast<T>()),
      (dq.w() < T(0.0) ? T(-2.0) : T(2.0)) * dq.vec();
  return error;
}

struct OdometryCost {
  OdometryEdge edge;
  Vector6 weight = walk_variance(edge).cwiseSqrt().cwiseInverse();
  BiasJacobian bias = bias_jacobian(edge);

  template <class T>
  bool operator()(const T* qa, const T* ta, const T* qb, const T* tb, const T* biases, T* residual) const {
    const Eigen::Matrix<T, 3, 1> deviations =
        Eigen::Map<const Eigen::Matrix<T, 3, 1>>(biases).cwiseProduct(bias_deviation().cast<T>());
    const Eigen::Matrix<T, 6, 1> error =
        relative_error(edge.T_from_to, qa, ta, qb, tb) + bias.cast<T>() * deviations;
    Eigen::Map<Eigen::Matrix<T, 6, 1>> weighted(residual);
    weighted = weight.cast<T>().cwiseProduct(error);
    return true;
  }
};

struct LoopCost {
  SE3 T_reference_moving;
  Matrix6 root;  ///< root^T * root is the information

  template <class T>
  bool operator()(const T* qa, const T* ta, const T* qb, const T* tb, T* residual) const {
    Eigen::Map<Eigen::Matrix<T, 6, 1>> weighted(residual);
    weighted = root.cast<T>() * relative_error(T_reference_moving, qa, ta, qb, tb);
    return true;
  }
};

/// The node's axis that odometry has for vertical is vertical.
struct GravityCost {
  Vector3 up;  ///< in axes of the node

  template <class T>
  bool operator()(const T* q, T* residual) const {
    const Eigen::Matrix<T, 3, 1> v = Eigen::Map<const Eigen::Quaternion<T>>(q) * up.cast<T>().eval();
    residual[0] = v.x() / T(kTiltDeviation);
    residual[1] = v.y() / T(kTiltDeviation);
    return true;
  }
};

/// Biases in units of their deviations.
struct BiasPrior {
  template <class T>
  bool operator()(const T* biases, T* residual) const {
    std::copy(biases, biases + 3, residual);
    return true;
  }
};

Matrix6 root_of(const Matrix6& information) { return information.llt().matrixU(); }

class Graph {
 public:
  Graph(std::span<const SE3> odometry, std::span<const OdometryEdge> edges, std::span<const LoopEdge> loops)
      : nodes_(odometry.begin(), odometry.end()), loops_(loops) {
    auto* const manifold = new ceres::AutoDiffManifold<QuaternionRetraction, 4, 3>;
    for (const SE3& node : nodes_) {
      problem_.AddParameterBlock(q(node), 4, manifold);
      problem_.AddParameterBlock(t(node), 3);
    }
    problem_.SetParameterBlockConstant(q(nodes_.front()));
    problem_.SetParameterBlockConstant(t(nodes_.front()));
    for (std::size_t i = 0; i + 1 < nodes_.size(); ++i) {
      problem_.AddResidualBlock(
          new ceres::AutoDiffCostFunction<OdometryCost, 6, 4, 3, 4, 3, 3>(new OdometryCost{edges[i]}),
          nullptr, q(nodes_[i]), t(nodes_[i]), q(nodes_[i + 1]), t(nodes_[i + 1]), biases_.data());
      problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<GravityCost, 2, 4>(
                                    new GravityCost{odometry[i + 1].rotation.conjugate() * Vector3::UnitZ()}),
                                nullptr, q(nodes_[i + 1]));
    }
    if (nodes_.size() > 1)
      problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<BiasPrior, 3, 3>(new BiasPrior), nullptr,
                                biases_.data());
    for (const LoopEdge& loop : loops) {
      losses_.push_back(new ceres::LossFunctionWrapper(nullptr, ceres::TAKE_OWNERSHIP));
      problem_.AddResidualBlock(new ceres::AutoDiffCostFunction<LoopCost, 6, 4, 3, 4, 3>(
                                    new LoopCost{loop.T_reference_moving, root_of(loop.information)}),
                                losses_.back(), q(nodes_[loop.reference]), t(nodes_[loop.reference]),
                                q(nodes_[loop.moving]), t(nodes_[loop.moving]));
    }
  }

  void set_weight(std::size_t loop, double weight) {
    losses_[loop]->Reset(new ceres::ScaledLoss(nullptr, weight, ceres::TAKE_OWNERSHIP),
                         ceres::TAKE_OWNERSHIP);
  }

  void solve() {
    ceres::Solver::Options options;
    options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    // No BLAS, whose bits depend on the processor.
    options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
    options.num_threads = 1;
    options.logging_type = ceres::SILENT;
    options.max_num_iterations = 20;
    options.function_tolerance = 1e-9;
    // Nearly Gauss-Newton: damping would hold the shape of a long chain, whose bending is cheap.
    options.initial_trust_region_radius = 1e12;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem_, &summary);
  }

  /// Squared Mahalanobis norm of a loop's residual.
  [[nodiscard]] double square(std::size_t i) const {
    const LoopEdge& loop = loops_[i];
    const SE3& a = nodes_[loop.reference];
    const SE3& b = nodes_[loop.moving];
    const Vector6 error =
        relative_error(loop.T_reference_moving, a.rotation.coeffs().data(), a.translation.data(),
                       b.rotation.coeffs().data(), b.translation.data());
    return error.dot(loop.information * error);
  }

  [[nodiscard]] const std::vector<SE3>& nodes() const { return nodes_; }
  [[nodiscard]] Eigen::Vector3d biases() const {
    return Eigen::Map<const Eigen::Vector3d>(biases_.data()).cwiseProduct(bias_deviation());
  }

 private:
  static double* q(SE3& node) { return node.rotation.coeffs().data(); }
  static double* q(const SE3& node) { return const_cast<SE3&>(node).rotation.coeffs().data(); }
  static double* t(SE3& node) { return node.translation.data(); }
  static double* t(const SE3& node) { return const_cast<SE3&>(node).translation.data(); }

  std::vector<SE3> nodes_;
  std::span<const LoopEdge> loops_;
  std::array<double, 3> biases_{};
  std::vector<ceres::LossFunctionWrapper*> losses_;  // of the problem
  ceres::Problem problem_;
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
  graph.solve();
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
    graph.solve();
    if (mu <= 1.0) break;
  }
  if (largest > kInlierSquare) {
    for (std::size_t i = 0; i < loops.size(); ++i) {
      solution.is_inlier[i] = weights[i] > kMinWeight;
      graph.set_weight(i, solution.is_inlier[i] ? 1.0 : 0.0);
    }
    graph.solve();
  }
  // Relative to the deviations: they are small numbers.
  const Eigen::Vector3d relative = graph.biases().cwiseQuotient(bias_deviation());
  solution.biases = relative.unaryExpr(&rounded).cwiseProduct(bias_deviation());
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
