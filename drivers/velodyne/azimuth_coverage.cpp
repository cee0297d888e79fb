#include "drivers/velodyne/azimuth_coverage.hpp"

#include "nilio/core/portable_math.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace nilio::drivers {
namespace {

constexpr int kUnitsPerBin = 100;
/// One scan in a thousand has a longer gap by chance.
constexpr double kRarity = 1e-3;
/// From here on, firings on one side only do not surround the sensor.
constexpr double kHalfTurnDeg = 180.0;

/// Widest gap that lost packets explain.
double chance_gap_deg(double packet_deg, double lost_share, double view_deg) {
  if (packet_deg <= 0.0 || lost_share <= 0.0) return packet_deg;
  if (lost_share >= 1.0) return kHalfTurnDeg;
  const double packets = view_deg / packet_deg;
  const double run = portable::log(packets / kRarity) / -portable::log(lost_share);
  return std::min(packet_deg * (1.0 + run), kHalfTurnDeg);
}

}  // namespace

void AzimuthCoverage::add(std::uint16_t azimuth, float advance) {
  const int first = azimuth / kUnitsPerBin;
  const int last = (azimuth + static_cast<int>(advance) - 1) / kUnitsPerBin;
  fired_.set(static_cast<std::size_t>(first % kBins));
  for (int bin = first + 1; bin <= last; ++bin) fired_.set(static_cast<std::size_t>(bin % kBins));
}

double AzimuthCoverage::covered_deg(double packet_deg, const BlindSector& blind) const {
  const int from = blind.is_known() ? blind.to() / kUnitsPerBin : 0;
  const int last = blind.is_known() ? blind.from() / kUnitsPerBin : kBins - 1;
  const int view = (last - from + kBins) % kBins + 1;
  const auto fired = [&](int i) { return fired_.test(static_cast<std::size_t>((from + i % view) % kBins)); };
  int start = 0;
  while (start < view && !fired(start)) ++start;
  if (start == view) return 0.0;
  std::array<int, kBins> gaps{};
  std::size_t count = 0;
  int gap = 0;
  int missing = 0;
  int widest = 0;
  for (int i = 1; i <= view; ++i) {
    if (!fired(start + i)) {
      ++gap;
      continue;
    }
    if (gap > 0) gaps[count++] = gap;
    missing += gap;
    widest = std::max(widest, gap);
    gap = 0;
  }
  const double lost_share = static_cast<double>(missing - widest) / static_cast<double>(view - widest);
  // Gaps are measured in whole bins.
  const double allowed = chance_gap_deg(packet_deg, lost_share, view) + 1.0;
  double covered = view;
  for (std::size_t i = 0; i < count; ++i) {
    if (gaps[i] > allowed || gaps[i] >= kHalfTurnDeg) covered -= gaps[i];
  }
  return covered;
}

}  // namespace nilio::drivers
