#include "tools/bench/realism/scan_statistics.hpp"

#include "tools/common/statistics.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <unordered_map>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

namespace nilio::tools::bench {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kVoxelM = 0.5;
constexpr int kLeastPoints = 8;
constexpr double kNearestM = 2.0;
/// Elevation below which a roof-mounted LiDAR looks at its own vehicle.
constexpr double kLowElevation = -20.0 * std::numbers::pi / 180.0;

std::int64_t cell_key(double x, double y, double z, double cell) {
  const auto index = [&](double v) { return static_cast<std::int64_t>(std::floor(v / cell)) & 0x1FFFFF; };
  return index(x) | index(y) << 21 | index(z) << 42;
}

double quantile(std::vector<double> values, double share) {
  return values.empty() ? std::nan("") : order_statistic(std::move(values), share);
}

double robust_sigma(std::vector<double> values) {
  const double median = quantile(values, 0.5);
  for (double& value : values) value = std::abs(value - median);
  return 1.4826 * quantile(values, 0.5);
}

double share_below(const std::vector<double>& values, double limit) {
  if (values.empty()) return std::nan("");
  const auto count = std::count_if(values.begin(), values.end(), [&](double v) { return v < limit; });
  return 100.0 * static_cast<double>(count) / static_cast<double>(values.size());
}

/// Points of a voxel, and the plane through them.
struct Voxel {
  int count = 0;
  Vector3d sum = Vector3d::Zero();
  Matrix3d squares = Matrix3d::Zero();
  Vector3d mean = Vector3d::Zero();
  Vector3d normal = Vector3d::Zero();
  double thickness = 0.0;
  double second = 0.0;

  void fit() {
    mean = sum / count;
    const Matrix3d scatter = squares / count - mean * mean.transpose();
    const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(scatter);
    normal = solver.eigenvectors().col(0);
    thickness = std::sqrt(std::max(0.0, solver.eigenvalues()[0]));
    second = std::sqrt(std::max(0.0, solver.eigenvalues()[1]));
  }
};

Vector3d position(const core::Point& p) {
  return {static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)};
}

}  // namespace

/// A return of one laser with the number of its firing in the revolution.
struct ScanStatistics::RingPoint {
  double azimuth = 0.0;
  double range = 0.0;
  double z = 0.0;
};

ScanStatistics::ScanStatistics(double firings_per_ring, double sensor_height_m)
    : firings_per_ring_(firings_per_ring), sensor_height_m_(sensor_height_m) {}

void ScanStatistics::add(const core::Scan& scan) {
  std::map<int, std::vector<RingPoint>> rings;
  std::map<int, double> elevation;
  for (const core::Point& point : scan.points) {
    const Vector3d p = position(point);
    const double range = p.norm();
    rings[point.ring].push_back({std::atan2(p.y(), p.x()), range, p.z()});
    elevation[point.ring] += std::asin(p.z() / range);
    if (range > kNearestM) points_ += 1.0;
    constexpr std::array<double, 7> kLimits{2.0, 5.0, 10.0, 20.0, 30.0, 50.0, 80.0};
    for (std::size_t b = 0; b < range_counts_.size(); ++b)
      if (range >= kLimits[b] && range < kLimits[b + 1]) range_counts_[b] += 1.0;
    intensities_.push_back(point.intensity);
  }
  for (auto& [ring, points] : rings) {
    const auto count = static_cast<double>(points.size());
    fired_ += firings_per_ring_;
    returned_ += count;
    if (elevation[ring] / count < kLowElevation) {
      fired_low_ += firings_per_ring_;
      returned_low_ += count;
    }
    std::sort(points.begin(), points.end(),
              [](const RingPoint& a, const RingPoint& b) { return a.azimuth < b.azimuth; });
    add_ring(points);
  }
  add_voxels(scan);
  add_isolated(scan);
  ++scans_;
}

void ScanStatistics::add_ring(const std::vector<RingPoint>& ring) {
  const double step = 2.0 * std::numbers::pi / firings_per_ring_;
  const auto fired_between = [&](std::size_t i) {
    return std::lround((ring[i + 1].azimuth - ring[i].azimuth) / step);
  };
  for (std::size_t i = 0; i + 2 < ring.size(); ++i) {
    const double r = ring[i + 1].range;
    if (fired_between(i) > 1 || fired_between(i + 1) > 1) continue;
    const double bend = r - 0.5 * (ring[i].range + ring[i + 2].range);
    if (std::abs(bend) > 0.1 || r < 3.0 || r >= 50.0) continue;
    differences_[r < 20.0 ? 0 : r < 30.0 ? 1 : 2].push_back(1000.0 * bend);
  }
  for (std::size_t i = 0; i + 1 < ring.size(); ++i) {
    const RingPoint& a = ring[i];
    const RingPoint& b = ring[i + 1];
    if (a.range < 3.0 || std::abs(a.range - b.range) > 0.03 * a.range) continue;
    const bool ground = a.z < 0.5 - sensor_height_m_;
    if (a.range >= (ground ? 25.0 : 30.0)) continue;
    const std::size_t bin = (ground ? 0U : 2U) + (a.range >= 15.0 ? 1U : 0U);
    const long fired = fired_between(i);
    hole_firings_[bin] += static_cast<double>(std::max(1L, std::min(fired, 6L)));
    if (fired >= 2 && fired <= 6) holes_[bin] += static_cast<double>(fired - 1);
  }
  // Clean edges: six smooth points on either side of a jump of more than 1.5 m, with one point between or
  // none.
  constexpr std::size_t kSmooth = 6;
  const auto smooth = [&](std::size_t first) {
    for (std::size_t k = first; k + 1 < first + kSmooth; ++k)
      if (fired_between(k) > 1 || std::abs(ring[k + 1].range - ring[k].range) > 0.05 + 0.01 * ring[k].range)
        return false;
    return true;
  };
  for (std::size_t i = 0; i + 2 * kSmooth + 1 < ring.size(); ++i) {
    const std::size_t end = i + kSmooth - 1;
    for (const std::size_t between : {std::size_t{0}, std::size_t{1}}) {
      const std::size_t next = end + 1 + between;
      const double jump = ring[next].range - ring[end].range;
      const double near = std::min(ring[next].range, ring[end].range);
      if (std::abs(jump) < 1.5 || near < 3.0 || near > 50.0) continue;
      if (between == 1) {
        const double middle = ring[end + 1].range;
        const double place = (middle - near) / std::abs(jump);
        if (place < 0.02 || place > 0.98 || fired_between(end) > 1 || fired_between(end + 1) > 1) continue;
        if (!smooth(i) || !smooth(next)) continue;
        edges_ += 1.0;
        mixed_ += 1.0;
        if (place < 0.2) mixed_near_ += 1.0;
      } else if (fired_between(end) <= 3 && smooth(i) && smooth(next)) {
        edges_ += 1.0;
      }
    }
  }
}

void ScanStatistics::add_voxels(const core::Scan& scan) {
  std::unordered_map<std::int64_t, Voxel> voxels;
  const auto used = [](const Vector3d& p) {
    const double range = p.norm();
    return range > 3.0 && range < 60.0;
  };
  for (const core::Point& point : scan.points) {
    const Vector3d p = position(point);
    if (!used(p)) continue;
    Voxel& voxel = voxels[cell_key(p.x(), p.y(), p.z(), kVoxelM)];
    ++voxel.count;
    voxel.sum += p;
    voxel.squares += p * p.transpose();
  }
  for (auto& [key, voxel] : voxels) {
    if (voxel.count < kLeastPoints) continue;
    voxel.fit();
    voxels_ += 1.0;
    if (voxel.second < 0.05) continue;
    areal_voxels_ += 1.0;
    const double millimetres = 1000.0 * voxel.thickness;
    areal_.push_back(millimetres);
    const double up = std::abs(voxel.normal.z());
    if (up > 0.95 && voxel.mean.z() < 0.53 - sensor_height_m_) ground_.push_back(millimetres);
    if (up < 0.2) vertical_.push_back(millimetres);
  }
  for (const core::Point& point : scan.points) {
    const Vector3d p = position(point);
    if (!used(p)) continue;
    const Voxel& voxel = voxels[cell_key(p.x(), p.y(), p.z(), kVoxelM)];
    if (voxel.count < kLeastPoints) continue;
    const double off = voxel.normal.dot(p - voxel.mean);
    residuals_.push_back(1000.0 * std::abs(off));
    const double cosine = voxel.normal.dot(p) / p.norm();
    if (voxel.thickness > 0.05 || voxel.count < 20 || std::abs(cosine) < 0.5) continue;
    ring_residuals_[scans_ % 2][point.ring].push_back(1000.0 * off / cosine);
  }
}

void ScanStatistics::add_isolated(const core::Scan& scan) {
  constexpr double kCell = 1.0;
  std::unordered_map<std::int64_t, std::vector<std::uint32_t>> cells;
  const auto near = [](const core::Point& a, const core::Point& b, double limit) {
    return (position(a) - position(b)).squaredNorm() < limit * limit;
  };
  const auto count = static_cast<std::uint32_t>(scan.points.size());
  for (std::uint32_t i = 0; i < count; ++i)
    cells[cell_key(static_cast<double>(scan.points[i].x), static_cast<double>(scan.points[i].y),
                   static_cast<double>(scan.points[i].z), kCell)]
        .push_back(i);
  for (std::uint32_t i = 0; i < count; ++i) {
    const core::Point& point = scan.points[i];
    const Vector3d p = position(point);
    const double limit = std::min(kCell, 0.3 + 0.01 * p.norm());
    bool alone = true;
    for (int k = 0; k < 27 && alone; ++k) {
      // The cell of the point itself first.
      const int n = (k + 13) % 27;
      const auto found = cells.find(cell_key(p.x() + kCell * (n % 3 - 1), p.y() + kCell * (n / 3 % 3 - 1),
                                             p.z() + kCell * (n / 9 - 1), kCell));
      if (found == cells.end()) continue;
      for (const std::uint32_t j : found->second) {
        if (j == i || !near(point, scan.points[j], limit)) continue;
        alone = false;
        break;
      }
    }
    if (alone) isolated_ += 1.0;
  }
}

std::vector<ScanStatistics::Row> ScanStatistics::rows() const {
  const double scans = static_cast<double>(scans_);
  std::vector<double> even;
  std::vector<double> odd;
  std::vector<double> both;
  for (const auto& [ring, residuals] : ring_residuals_[0]) {
    const auto other = ring_residuals_[1].find(ring);
    if (other == ring_residuals_[1].end() || residuals.size() < 30 || other->second.size() < 30) continue;
    even.push_back(quantile(residuals, 0.5));
    odd.push_back(quantile(other->second, 0.5));
    std::vector<double> all = residuals;
    all.insert(all.end(), other->second.begin(), other->second.end());
    both.push_back(quantile(all, 0.5));
  }
  const auto mean = [](const std::vector<double>& v) {
    return v.empty() ? 0.0 : std::accumulate(v.begin(), v.end(), 0.0) / static_cast<double>(v.size());
  };
  const auto covariance = [&](const std::vector<double>& a, const std::vector<double>& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - mean(a)) * (b[i] - mean(b));
    return sum / static_cast<double>(std::max<std::size_t>(1, a.size()));
  };
  const double in_ranges = std::accumulate(range_counts_.begin(), range_counts_.end(), 0.0);
  std::vector<double> ranges;
  for (const double n : range_counts_) ranges.push_back(100.0 * n / in_ranges);
  const auto ring_noise = [&](std::size_t bin) { return robust_sigma(differences_[bin]) / std::sqrt(1.5); };
  const auto hole = [&](std::size_t bin) { return 100.0 * holes_[bin] / hole_firings_[bin]; };
  const std::vector<double> bytes(intensities_.begin(), intensities_.end());
  const auto four = [](const std::vector<double>& v) {
    return std::vector<double>{quantile(v, 0.5), quantile(v, 0.75), quantile(v, 0.9), quantile(v, 0.97)};
  };
  return {
      {"areal voxels thinner than 3 / 5, thicker than 10 cm, %",
       {share_below(areal_, 30.0), share_below(areal_, 50.0), 100.0 - share_below(areal_, 100.0)},
       1},
      {"vertical thickness p50 / 75 / 90 / 97, mm", four(vertical_), 1},
      {"ground thickness p50 / 75 / 90 / 97, mm", four(ground_), 1},
      {"noise in the ring 3-20 / 20-30 / 30-50 m, mm", {ring_noise(0), ring_noise(1), ring_noise(2)}, 1},
      {"ring bias, mm; correlation of odd and even scans",
       {std::sqrt(covariance(both, both)),
        covariance(even, odd) / std::sqrt(covariance(even, even) * covariance(odd, odd))},
       2},
      {"residual to own voxel's plane p50 / 90 / 99, mm",
       {quantile(residuals_, 0.5), quantile(residuals_, 0.9), quantile(residuals_, 0.99)},
       1},
      {"returned share; below -20 deg", {returned_ / fired_, returned_low_ / fired_low_}, 2},
      {"points beyond 2 m, thousands a scan", {points_ / scans / 1000.0}, 1},
      {"range 2-5 / 5-10 / 10-20 / 20-30 / 30-50 / 50-80 m, %", ranges, 1},
      {"holes, ground 3-15 / 15-25 m; other 3-15 / 15-30 m, %", {hole(0), hole(1), hole(2), hole(3)}, 2},
      {"isolated points, %; P(mixed); its first fifth, %",
       {100.0 * isolated_ / points_, mixed_ / edges_, 100.0 * mixed_near_ / mixed_},
       3},
      {"voxels of 8 points a scan; areal share", {voxels_ / scans, areal_voxels_ / voxels_}, 2},
      {"intensity median / p95; zero, %",
       {quantile(bytes, 0.5), quantile(bytes, 0.95), share_below(bytes, 0.5)},
       1},
  };
}

}  // namespace nilio::tools::bench
