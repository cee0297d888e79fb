#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "tools/convert/convert.hpp"
#include "tools/convert/kitti_raw_encoder.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

namespace nilio::tools::convert {

namespace {

struct Candidate {
  double yaw = 0.0;
  const KittiPoint* point = nullptr;
};

/// Points of one scan by ring (0 = lowest) and yaw.
class OriginalScan {
 public:
  static core::Result<OriginalScan> load(const KittiRawScan& scan) {
    auto points = read_kitti_scan(scan.path);
    if (!points) return points.error();
    OriginalScan original;
    original.start_ = scan.start;
    original.end_ = scan.end;
    original.points_ = std::move(points).value();
    const std::vector<std::uint16_t> rings = kitti_rings(original.points_);
    for (std::size_t i = 0; i < rings.size(); ++i) {
      if (rings[i] >= kHdlLasers) continue;
      const KittiPoint& p = original.points_[i];
      original.rings_[kHdlLasers - 1 - rings[i]].push_back({std::atan2(p.y, p.x), &p});
    }
    for (auto& ring : original.rings_) {
      std::sort(ring.begin(), ring.end(),
                [](const Candidate& a, const Candidate& b) { return a.yaw < b.yaw; });
    }
    return original;
  }

  /// The time of a column is uncertain by the packet's microseconds and the nominal firing times of the
  /// format.
  [[nodiscard]] bool covers(core::Time stamp) const {
    constexpr core::Duration column_period{50'000};
    return stamp >= start_ - column_period && stamp < end_ + column_period;
  }

  /// Infinite when the ring is empty.
  [[nodiscard]] double distance(const core::Point& point) const {
    if (point.ring >= kHdlLasers || rings_[point.ring].empty()) {
      return std::numeric_limits<double>::infinity();
    }
    const std::vector<Candidate>& ring = rings_[point.ring];
    const double yaw = std::atan2(point.y, point.x);
    const auto next = std::lower_bound(ring.begin(), ring.end(), yaw,
                                       [](const Candidate& c, double value) { return c.yaw < value; });
    constexpr std::size_t neighbours = 3;
    const std::size_t n = ring.size();
    const std::size_t first = static_cast<std::size_t>(next - ring.begin()) + n * neighbours - neighbours;
    double best = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < 2 * neighbours; ++k) {
      const KittiPoint& p = *ring[(first + k) % n].point;
      best = std::min(best, static_cast<double>(std::hypot(p.x - point.x, p.y - point.y, p.z - point.z)));
    }
    return best;
  }

  [[nodiscard]] core::Time end() const { return end_; }
  [[nodiscard]] std::size_t size() const { return points_.size(); }

 private:
  core::Time start_;
  core::Time end_;
  std::vector<KittiPoint> points_;
  std::array<std::vector<Candidate>, kHdlLasers> rings_;
};

/// Distribution of any number of distances in bounded memory; quantiles to 0.01 mm.
class DistanceHistogram {
 public:
  void add(double distance_m) {
    const double bin = std::min(distance_m / kBinM, static_cast<double>(kBins - 1));
    ++counts_[static_cast<std::size_t>(bin)];
    ++total_;
    max_m_ = std::max(max_m_, distance_m);
  }

  [[nodiscard]] double quantile(double share) const {
    const auto rank = static_cast<std::uint64_t>(share * static_cast<double>(total_));
    std::uint64_t seen = 0;
    for (std::size_t bin = 0; bin < kBins; ++bin) {
      seen += counts_[bin];
      if (seen > rank) return std::min((static_cast<double>(bin) + 0.5) * kBinM, max_m_);
    }
    return max_m_;
  }
  [[nodiscard]] double max() const { return max_m_; }

 private:
  static constexpr double kBinM = 1e-5;
  static constexpr std::size_t kBins = 100'000;
  std::vector<std::uint64_t> counts_ = std::vector<std::uint64_t>(kBins, 0);
  std::uint64_t total_ = 0;
  double max_m_ = 0.0;
};

/// Compares decoded points, in order of time, with the scans around them.
class Comparison {
 public:
  explicit Comparison(std::span<const KittiRawScan> scans) : scans_(scans) {}

  /// Empty, or the reason why a scan could not be read.
  std::string add(const core::Scan& decoded) {
    std::string problem = load_until(decoded.end);
    if (!problem.empty()) return problem;
    for (const core::Point& point : decoded.points) {
      const core::Time stamp = decoded.start + core::Duration{point.time_offset_ns};
      double best = std::numeric_limits<double>::infinity();
      for (const OriginalScan& original : loaded_) {
        if (original.covers(stamp)) best = std::min(best, original.distance(point));
      }
      ++result_.decoded_points;
      if (std::isfinite(best)) {
        distances_.add(best);
      } else {
        ++result_.unexplained_points;
      }
    }
    constexpr core::Duration keep_for{1'000'000};
    std::erase_if(loaded_,
                  [&](const OriginalScan& original) { return original.end() + keep_for < decoded.end; });
    return {};
  }

  core::Result<ConversionCheck> finish() {
    // Scans without any decoded point count as missing points.
    while (next_ < scans_.size()) {
      const std::string problem = load_until(scans_[next_].start);
      if (!problem.empty()) return core::Error{problem};
      loaded_.clear();
    }
    result_.median_m = distances_.quantile(0.5);
    result_.p99_m = distances_.quantile(0.99);
    result_.max_m = distances_.max();
    return result_;
  }

 private:
  std::string load_until(core::Time time) {
    constexpr core::Duration look_ahead{1'000'000};
    while (next_ < scans_.size() && scans_[next_].start - look_ahead <= time) {
      auto original = OriginalScan::load(scans_[next_++]);
      if (!original) return original.error().message;
      result_.original_points += original->size();
      loaded_.push_back(std::move(original).value());
    }
    return {};
  }

  std::span<const KittiRawScan> scans_;
  std::size_t next_ = 0;
  std::vector<OriginalScan> loaded_;
  DistanceHistogram distances_;
  ConversionCheck result_;
};

}  // namespace

core::Result<ConversionCheck> check_conversion(const std::string& pcap_path,
                                               std::span<const KittiRawScan> scans,
                                               const drivers::VelodyneSensor& sensor) {
  auto source = drivers::open_pcap(pcap_path, {});
  if (!source) return source.error();
  drivers::ScanAssemblerConfig config;
  config.time_source = drivers::TimeSource::kSensor;
  config.min_range_m = 0.0;
  config.max_range_m = 1000.0;
  config.min_coverage = 0.0;
  drivers::ScanAssembler assembler(sensor, config);
  Comparison comparison(scans);
  core::Scan decoded;
  std::vector<drivers::Packet> packets(64);
  const auto take = [&]() {
    assembler.take_scan(decoded);
    return comparison.add(decoded);
  };
  while (true) {
    const drivers::SourceRead read = (*source)->read(packets, core::Duration{});
    if (read.state == drivers::SourceState::kFailed) return core::Error{(*source)->status()};
    if (read.state == drivers::SourceState::kEnd) break;
    for (std::size_t i = 0; i < read.count; ++i) {
      if (!assembler.add(packets[i])) continue;
      const std::string problem = take();
      if (!problem.empty()) return core::Error{problem};
    }
  }
  if (assembler.finish()) {
    const std::string problem = take();
    if (!problem.empty()) return core::Error{problem};
  }
  return comparison.finish();
}

}  // namespace nilio::tools::convert
