#include "drivers/velodyne/blind_sector.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include <cstdlib>

namespace nilio::drivers {
namespace {

/// 3 degrees: fields of view are set in whole degrees, and packets end where they are full.
constexpr int kTolerance = 300;
/// A smaller gap can be packets lost repeatedly at the same azimuth.
constexpr int kSmallest = 1000;
constexpr int kRevolutionsToAccept = 3;

int modulo(int azimuth) { return (azimuth % kAzimuthModulus + kAzimuthModulus) % kAzimuthModulus; }

bool near(std::uint16_t a, std::uint16_t b) {
  const int difference = modulo(static_cast<int>(a) - static_cast<int>(b));
  return difference <= kTolerance || difference >= kAzimuthModulus - kTolerance;
}

}  // namespace

int BlindSector::Sector::width() const { return modulo(static_cast<int>(to) - static_cast<int>(from)); }

bool BlindSector::Sector::is_like(const Sector& other) const {
  return near(from, other.from) && near(to, other.to) && std::abs(width() - other.width()) <= 2 * kTolerance;
}

void BlindSector::on_gap_inside_packet(std::uint16_t from, std::uint16_t to) {
  const Sector seen{from, to};
  if (seen.width() < kSmallest) return;
  sector_ = seen;
  known_ = true;
}

bool BlindSector::explains(const Gap& gap, std::uint32_t& wrongly_counted) {
  wrongly_counted = 0;
  const Sector sector{gap.from, gap.to};
  if (sector.width() < kSmallest) return false;
  if (known_ && sector_.is_like(sector)) return true;
  const std::int64_t since_ns = gap.time_ns - candidate_time_ns_;
  const bool next_revolution = std::abs(since_ns - gap.revolution_ns) < gap.revolution_ns / 8;
  if (candidate_seen_ == 0 || !next_revolution || !candidate_.is_like(sector)) {
    candidate_ = sector;
    candidate_seen_ = 0;
    candidate_packets_ = 0;
  }
  candidate_time_ns_ = gap.time_ns;
  if (++candidate_seen_ < kRevolutionsToAccept) {
    candidate_packets_ += gap.packets;
    return false;
  }
  wrongly_counted = candidate_packets_;
  candidate_seen_ = 0;
  sector_ = sector;
  known_ = true;
  return true;
}

bool BlindSector::ends_at(std::uint16_t azimuth) const { return known_ && near(azimuth, sector_.to); }

void BlindSector::on_firing(std::uint16_t azimuth) {
  if (!known_) return;
  const int inside = modulo(static_cast<int>(azimuth) - static_cast<int>(sector_.from));
  if (inside > kTolerance && inside < sector_.width() - kTolerance) known_ = false;
}

}  // namespace nilio::drivers
