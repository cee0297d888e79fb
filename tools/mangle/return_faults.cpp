#include "tools/mangle/return_faults.hpp"

#include "tools/simulate/random.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace nilio::tools::mangle {

namespace {

using simulate::random_word;
using simulate::to_gaussian;
using simulate::to_unit_interval;

// Random numbers of a return: hash of seed, scan and index, so that one fault does not change another.
constexpr std::uint64_t kThinning = 201;
constexpr std::uint64_t kNoise = 202;
constexpr std::uint64_t kGhosts = 203;
constexpr std::uint64_t kGhostRanges = 204;

constexpr float kMinGhostRange = 2.0F;
constexpr float kMaxGhostRange = 100.0F;
// Steps of a packet's distances are 2 mm or more: 0 would mean a missing return.
constexpr float kMinRange = 0.01F;

std::uint64_t word(std::uint64_t seed, std::uint64_t purpose, std::uint64_t scan, std::uint64_t index) {
  return random_word(seed ^ simulate::mix_bits(purpose), scan, index);
}

bool is_in_view(const Eigen::Vector3f& p, double field_of_view_deg) {
  if (field_of_view_deg >= 360.0) return true;
  const double azimuth_deg = std::atan2(p.y(), p.x()) * 180.0 / std::numbers::pi;
  return std::abs(azimuth_deg) <= 0.5 * field_of_view_deg;
}

}  // namespace

std::vector<bool> choose_rings(unsigned rings, unsigned kept) {
  if (kept == 0 || kept >= rings) return std::vector<bool>(rings, true);
  std::vector<bool> chosen(rings, false);
  // The middles of `kept` equal parts.
  for (unsigned i = 0; i < kept; ++i) chosen[(2U * i + 1U) * rings / (2U * kept)] = true;
  return chosen;
}

ReturnFaults::ReturnFaults(const Faults& faults, unsigned rings)
    : faults_(faults), kept_rings_(choose_rings(rings, faults.rings)) {}

bool ReturnFaults::is_selected(const Return& given, bool vegetation) {
  if (given.ring >= kept_rings_.size() || !kept_rings_[given.ring]) {
    ++counts_.other_rings;
    return false;
  }
  if (!is_in_view(given.position, faults_.field_of_view_deg)) {
    ++counts_.outside_view;
    return false;
  }
  if (vegetation) return true;
  ++counts_.not_vegetation;
  return false;
}

/// Removes returns by --thin or --points; the smallest random numbers remain.
void ReturnFaults::thin(std::uint64_t number, std::vector<EditedReturn>& out) {
  if (faults_.thin >= 1.0 && faults_.points == 0) return;
  std::vector<std::pair<std::uint64_t, std::size_t>> order;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (out[i].range_m > 0.0F) order.emplace_back(word(faults_.seed, kThinning, number, i), i);
  }
  std::size_t kept = static_cast<std::size_t>(faults_.points);
  if (faults_.points == 0)
    kept = static_cast<std::size_t>(std::lround(faults_.thin * static_cast<double>(order.size())));
  if (kept >= order.size()) return;
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(kept), order.end());
  for (std::size_t k = kept; k < order.size(); ++k) out[order[k].second].range_m = 0.0F;
  counts_.thinned += order.size() - kept;
}

float ReturnFaults::disturbed_range(float range_m, std::uint64_t number, std::uint64_t index) {
  if (faults_.ghosts > 0.0 && to_unit_interval(word(faults_.seed, kGhosts, number, index)) < faults_.ghosts) {
    ++counts_.ghosts;
    const double share = to_unit_interval(word(faults_.seed, kGhostRanges, number, index));
    return kMinGhostRange + (kMaxGhostRange - kMinGhostRange) * static_cast<float>(share);
  }
  if (faults_.noise_m <= 0.0) return range_m;
  const double noise = faults_.noise_m * to_gaussian(word(faults_.seed, kNoise, number, index));
  return std::max(kMinRange, range_m + static_cast<float>(noise));
}

void ReturnFaults::apply(std::span<const Return> scan, std::uint64_t number, std::vector<EditedReturn>& out) {
  vegetation_ = faults_.vegetation_only ? find_vegetation(scan) : std::vector<bool>(scan.size(), true);
  out.assign(scan.size(), {});
  counts_.returns += scan.size();
  for (std::size_t i = 0; i < scan.size(); ++i) {
    if (is_selected(scan[i], vegetation_[i])) out[i].range_m = scan[i].position.norm();
  }
  thin(number, out);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (out[i].range_m <= 0.0F) continue;
    out[i].range_m = disturbed_range(out[i].range_m, number, i);
    ++counts_.kept;
  }
}

}  // namespace nilio::tools::mangle
