#include "tools/simulate/town/height_closure.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <unordered_map>

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

namespace nilio::tools::simulation {

namespace {

constexpr double kNodeSpacingM = 2.0;
/// Passes closer than this are on the same ground, oncoming lanes too.
constexpr double kSamePlaceM = 6.0;
/// Nodes less than 40 m of driving apart belong to one pass.
constexpr std::size_t kOwnPass = 20;
/// Weight of an even correction along the drive against equal heights at one place: bends spread over about
/// 20 m.
constexpr double kStiffness = 100.0;

/// Poses about every kNodeSpacingM, by index.
std::vector<std::size_t> choose_nodes(const std::vector<core::SE3>& poses) {
  std::vector<std::size_t> nodes{0};
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const auto moved = poses[i].translation - poses[nodes.back()].translation;
    if (moved.head<2>().norm() >= kNodeSpacingM) nodes.push_back(i);
  }
  return nodes;
}

struct Pair {
  std::size_t earlier;
  std::size_t later;
};

/// Nodes of different passes at the same place.
std::vector<Pair> find_pairs(const std::vector<core::SE3>& poses, const std::vector<std::size_t>& nodes) {
  const auto bucket = [](const core::Vector3& p, int dx, int dy) {
    const auto x = static_cast<std::int64_t>(std::floor(p.x() / kSamePlaceM)) + dx;
    const auto y = static_cast<std::int64_t>(std::floor(p.y() / kSamePlaceM)) + dy;
    return x * 4'000'037 + y;
  };
  std::unordered_map<std::int64_t, std::vector<std::size_t>> buckets;
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    const core::Vector3& here = poses[nodes[i]].translation;
    for (int k = 0; k < 9; ++k) {
      const auto found = buckets.find(bucket(here, k / 3 - 1, k % 3 - 1));
      if (found == buckets.end()) continue;
      for (const std::size_t j : found->second) {
        const double gap = (poses[nodes[j]].translation - here).head<2>().norm();
        if (j + kOwnPass < i && gap < kSamePlaceM) pairs.push_back({j, i});
      }
    }
    buckets[bucket(here, 0, 0)].push_back(i);
  }
  return pairs;
}

/// Corrections of the nodes' heights.
Eigen::VectorXd solve_corrections(const std::vector<core::SE3>& poses, const std::vector<std::size_t>& nodes,
                                  const std::vector<Pair>& pairs) {
  std::vector<Eigen::Triplet<double>> entries;
  Eigen::VectorXd right = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(nodes.size()));
  const auto connect = [&](std::size_t a, std::size_t b, double weight, double wanted_difference) {
    const auto i = static_cast<int>(a);
    const auto j = static_cast<int>(b);
    entries.emplace_back(i, i, weight);
    entries.emplace_back(j, j, weight);
    entries.emplace_back(i, j, -weight);
    entries.emplace_back(j, i, -weight);
    right[i] -= weight * wanted_difference;
    right[j] += weight * wanted_difference;
  };
  entries.emplace_back(0, 0, 1.0);
  for (std::size_t i = 1; i < nodes.size(); ++i) connect(i - 1, i, kStiffness, 0.0);
  for (const Pair& pair : pairs) {
    const double rise = poses[nodes[pair.later]].translation.z() - poses[nodes[pair.earlier]].translation.z();
    connect(pair.earlier, pair.later, 1.0, -rise);
  }
  Eigen::SparseMatrix<double> normal(right.size(), right.size());
  normal.setFromTriplets(entries.begin(), entries.end());
  return Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(normal).solve(right);
}

}  // namespace

void close_heights(std::vector<core::SE3>& poses) {
  const std::vector<std::size_t> nodes = choose_nodes(poses);
  const std::vector<Pair> pairs = find_pairs(poses, nodes);
  if (pairs.empty()) return;
  const Eigen::VectorXd corrections = solve_corrections(poses, nodes, pairs);
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const bool last = n + 1 == nodes.size();
    const std::size_t end = last ? poses.size() : nodes[n + 1];
    const double from = corrections[static_cast<Eigen::Index>(n)];
    const double to = corrections[static_cast<Eigen::Index>(last ? n : n + 1)];
    for (std::size_t i = nodes[n]; i < end; ++i) {
      const double share = static_cast<double>(i - nodes[n]) / static_cast<double>(end - nodes[n]);
      poses[i].translation.z() += std::lerp(from, to, share);
    }
  }
}

}  // namespace nilio::tools::simulation
