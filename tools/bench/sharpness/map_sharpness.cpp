#include "tools/bench/sharpness/map_sharpness.hpp"

#include "tools/common/statistics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <unordered_map>

#include <Eigen/Eigenvalues>

namespace nilio::tools::bench {

namespace {

using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kAnchorCellM = 1.0;
constexpr double kRadiusM = 0.5;
/// A scan has at most this weight at an anchor, so that dense scans do not dominate.
constexpr double kMaxVotes = 10.0;
constexpr double kMinPointsOfScan = 3.0;
constexpr std::size_t kMinScans = 3;
constexpr double kMinVotes = 12.0;
constexpr double kMaxThicknessM = 0.25;
constexpr double kMaxShiftM = 0.1;

/// Points of one scan at one anchor, relative to it.
struct ScanMoments {
  double count = 0.0;
  Vector3d sum = Vector3d::Zero();
  Matrix3d squares = Matrix3d::Zero();
};

/// Map at one anchor.
struct AnchorFigures {
  bool used = false;
  bool planar = false;
  double thickness_m = 0.0;
  double entropy = 0.0;
  double shift_m = 0.0;
};

/// Anchors by cells of the neighbourhood's radius.
class AnchorGrid {
 public:
  explicit AnchorGrid(const Cloud& anchors) : anchors_(anchors) {
    for (std::size_t i = 0; i < anchors.size(); ++i) cells_[key(cell_of(anchors[i]))].push_back(i);
  }

  /// Calls `visit(anchor, point relative to it)` for every anchor within the radius.
  template <class Visit>
  void for_each_near(const Vector3d& point, Visit visit) const {
    const Cell cell = cell_of(point);
    for (std::int64_t x = -1; x <= 1; ++x)
      for (std::int64_t y = -1; y <= 1; ++y)
        for (std::int64_t z = -1; z <= 1; ++z)
          visit_cell({cell[0] + x, cell[1] + y, cell[2] + z}, point, visit);
  }

 private:
  using Cell = std::array<std::int64_t, 3>;
  static Cell cell_of(const Vector3d& p) {
    const auto part = [](double v) { return static_cast<std::int64_t>(std::floor(v / kRadiusM)); };
    return {part(p.x()), part(p.y()), part(p.z())};
  }
  static std::int64_t key(const Cell& c) {
    constexpr std::int64_t offset = 100'000;
    return ((c[0] + offset) << 40) + ((c[1] + offset) << 20) + c[2] + offset;
  }
  template <class Visit>
  void visit_cell(const Cell& cell, const Vector3d& point, Visit& visit) const {
    const auto found = cells_.find(key(cell));
    if (found == cells_.end()) return;
    for (const std::size_t anchor : found->second) {
      const Vector3d relative = point - anchors_[anchor];
      if (relative.squaredNorm() < kRadiusM * kRadiusM) visit(anchor, relative);
    }
  }

  const Cloud& anchors_;
  std::unordered_map<std::int64_t, std::vector<std::size_t>> cells_;
};

/// Moments of one scan at all anchors.
std::vector<ScanMoments> scan_moments(const Cloud& scan, const Isometry3d& T_middle_scan,
                                      const AnchorGrid& grid, std::size_t anchors) {
  std::vector<ScanMoments> moments(anchors);
  for (const Vector3d& point : scan) {
    grid.for_each_near(T_middle_scan * point, [&](std::size_t anchor, const Vector3d& relative) {
      ScanMoments& m = moments[anchor];
      m.count += 1.0;
      m.sum += relative;
      m.squares += relative * relative.transpose();
    });
  }
  return moments;
}

AnchorFigures figures_at(std::size_t anchor, const std::vector<std::vector<ScanMoments>>& scans) {
  double votes = 0.0;
  std::size_t seen = 0;
  Vector3d sum = Vector3d::Zero();
  Matrix3d squares = Matrix3d::Zero();
  for (const auto& scan : scans) {
    const ScanMoments& m = scan[anchor];
    const double weight = std::min(m.count, kMaxVotes) / std::max(m.count, 1.0);
    votes += m.count * weight;
    sum += m.sum * weight;
    squares += m.squares * weight;
    if (m.count >= kMinPointsOfScan) ++seen;
  }
  AnchorFigures figures;
  figures.used = seen >= kMinScans && votes >= kMinVotes;
  if (!figures.used) return figures;
  const Vector3d mean = sum / votes;
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(squares / votes - mean * mean.transpose());
  const Vector3d l = solver.eigenvalues().cwiseMax(0.0);
  figures.thickness_m = std::sqrt(l[0]);
  const double logs = std::log(l[0] + 1e-6) + std::log(l[1] + 1e-6) + std::log(l[2] + 1e-6);
  figures.entropy = 0.5 * (3.0 * std::log(2.0 * std::numbers::pi * std::numbers::e) + logs);
  figures.planar = l[1] > 0.01 && l[0] < 0.05 * l[1];
  Spread offsets;
  for (const auto& scan : scans) {
    const ScanMoments& m = scan[anchor];
    if (m.count >= kMinPointsOfScan) offsets.add((m.sum / m.count - mean).dot(solver.eigenvectors().col(0)));
  }
  figures.shift_m = offsets.standard_deviation();
  return figures;
}

/// Values of one trajectory over all windows.
struct Values {
  std::vector<double> thickness;
  std::vector<double> entropy;
  std::vector<double> shift;
  double coverage = 0.0;
};

/// Linear interpolation between order statistics, as numpy has it.
double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const double place = share * static_cast<double>(values.size() - 1);
  const auto low = static_cast<std::size_t>(place);
  const std::size_t high = std::min(low + 1, values.size() - 1);
  return values[low] + (place - static_cast<double>(low)) * (values[high] - values[low]);
}

Sharpness summarise(const Values& values, std::size_t windows) {
  Sharpness result;
  double shift_square = 0.0;
  for (const double shift : values.shift) shift_square += std::pow(std::min(shift, kMaxShiftM), 2.0);
  result.shift_rms_mm = 1e3 * std::sqrt(shift_square / static_cast<double>(values.shift.size()));
  result.shift_median_mm = 1e3 * quantile(values.shift, 0.5);
  result.thickness_median_mm = 1e3 * quantile(values.thickness, 0.5);
  result.thickness_quartile_mm = 1e3 * quantile(values.thickness, 0.25);
  double entropy = 0.0;
  for (const double value : values.entropy) entropy += value;
  result.entropy = entropy / static_cast<double>(values.entropy.size());
  result.coverage = values.coverage / static_cast<double>(windows);
  result.anchors = values.thickness.size();
  result.windows = windows;
  return result;
}

std::vector<AnchorFigures> measure_window(std::span<const Cloud> scans,
                                          const std::vector<std::size_t>& members, std::size_t middle,
                                          const Cloud& anchors, const AnchorGrid& grid,
                                          const std::vector<Isometry3d>& poses) {
  std::vector<std::vector<ScanMoments>> moments;
  for (const std::size_t i : members) {
    if (i != middle)
      moments.push_back(scan_moments(scans[i], poses[middle].inverse() * poses[i], grid, anchors.size()));
  }
  std::vector<AnchorFigures> figures;
  for (std::size_t a = 0; a < anchors.size(); ++a) figures.push_back(figures_at(a, moments));
  return figures;
}

/// Adds the anchors that all trajectories have in common.
void add_common(const std::vector<std::vector<AnchorFigures>>& figures, std::vector<Values>& values) {
  const std::size_t anchors = figures.front().size();
  for (std::size_t a = 0; a < anchors; ++a) {
    const auto all = [&](auto test) {
      return std::all_of(figures.begin(), figures.end(), [&](const auto& f) { return test(f[a]); });
    };
    const bool used = all([](const AnchorFigures& f) { return f.used; });
    const bool thin = all([](const AnchorFigures& f) { return f.thickness_m < kMaxThicknessM; });
    const bool planar =
        std::any_of(figures.begin(), figures.end(), [&](const auto& f) { return f[a].planar; });
    for (std::size_t k = 0; used && k < figures.size(); ++k) {
      values[k].entropy.push_back(figures[k][a].entropy);
      if (!thin || !planar) continue;
      values[k].thickness.push_back(figures[k][a].thickness_m);
      values[k].shift.push_back(figures[k][a].shift_m);
    }
  }
  for (std::size_t k = 0; k < figures.size(); ++k) {
    const auto used =
        std::count_if(figures[k].begin(), figures[k].end(), [](const auto& f) { return f.used; });
    values[k].coverage += static_cast<double>(used) / static_cast<double>(std::max<std::size_t>(anchors, 1));
  }
}

}  // namespace

std::vector<Sharpness> measure_sharpness(std::span<const Cloud> scans,
                                         std::span<const std::vector<Isometry3d>> poses,
                                         const SharpnessOptions& options) {
  std::size_t count = scans.size();
  for (const auto& trajectory : poses) count = std::min(count, trajectory.size());
  std::vector<Values> values(poses.size());
  std::size_t windows = 0;
  for (std::size_t begin = 0; !poses.empty() && begin + options.window <= count; begin += options.hop) {
    std::vector<std::size_t> members;
    for (std::size_t i = begin; i < begin + options.window; i += options.stride) members.push_back(i);
    const std::size_t middle = members[members.size() / 2];
    const Cloud anchors = first_per_cell(scans[middle], kAnchorCellM);
    const AnchorGrid grid(anchors);
    std::vector<std::vector<AnchorFigures>> figures;
    for (const auto& trajectory : poses)
      figures.push_back(measure_window(scans, members, middle, anchors, grid, trajectory));
    add_common(figures, values);
    ++windows;
  }
  std::vector<Sharpness> results;
  for (std::size_t k = 0; windows > 0 && k < poses.size(); ++k)
    results.push_back(summarise(values[k], windows));
  return results;
}

}  // namespace nilio::tools::bench
