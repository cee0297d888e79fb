#include "drivers/velodyne/azimuth_coverage.hpp"

#include <random>

#include <catch2/catch.hpp>

using nilio::drivers::AzimuthCoverage;
using nilio::drivers::BlindSector;

namespace {

/// A VLP-16 at 10 revolutions a second: twelve steps of 0.4 degree in a packet.
constexpr float kStep = 40.0F;
constexpr double kPacketDeg = 4.8;
constexpr int kPacketsOfTurn = 75;

void add_packet(AzimuthCoverage& coverage, int packet) {
  for (int step = 0; step < 12; ++step)
    coverage.add(static_cast<std::uint16_t>((packet * 480 + step * 40) % 36000), kStep);
}

double covered(const AzimuthCoverage& coverage, const BlindSector& blind = {}) {
  return coverage.covered_deg(kPacketDeg, blind);
}

}  // namespace

TEST_CASE("a whole revolution and none", "[azimuth_coverage]") {
  AzimuthCoverage coverage;
  CHECK(covered(coverage) == 0.0);
  for (int i = 0; i < kPacketsOfTurn; ++i) add_packet(coverage, i);
  CHECK(covered(coverage) == 360.0);
  coverage.restart();
  CHECK(covered(coverage) == 0.0);
}

TEST_CASE("evenly lost packets leave the circle surrounded", "[azimuth_coverage]") {
  for (const double lost : {0.05, 0.2, 0.35, 0.5}) {
    int scans_below = 0;
    for (std::uint32_t seed = 0; seed < 2000; ++seed) {
      std::mt19937 random(seed);
      std::uniform_real_distribution<double> uniform(0.0, 1.0);
      AzimuthCoverage coverage;
      for (int i = 0; i < kPacketsOfTurn; ++i) {
        if (uniform(random) >= lost) add_packet(coverage, i);
      }
      scans_below += covered(coverage) < 0.8 * 360.0 ? 1 : 0;
    }
    INFO("lost " << lost);
    CHECK(scans_below <= 2);
  }
}

TEST_CASE("a missing sector is missing, with and without other losses", "[azimuth_coverage]") {
  for (const double lost : {0.0, 0.1, 0.25}) {
    for (const int missing : {25, 40, 60}) {
      std::mt19937 random(static_cast<std::uint32_t>(missing));
      std::uniform_real_distribution<double> uniform(0.0, 1.0);
      AzimuthCoverage coverage;
      for (int i = 0; i < kPacketsOfTurn - missing; ++i) {
        if (i == 0 || i + 1 == kPacketsOfTurn - missing || uniform(random) >= lost)
          add_packet(coverage, i + 30);
      }
      INFO("lost " << lost << ", missing " << missing * kPacketDeg);
      CHECK(covered(coverage) == Approx(360.0 - missing * kPacketDeg).margin(2.0 + 150.0 * lost));
      CHECK(covered(coverage) < 0.8 * 360.0);
    }
  }
}

TEST_CASE("a gap of one packet is no sector, a longer one among whole packets is", "[azimuth_coverage]") {
  AzimuthCoverage coverage;
  for (int i = 0; i < kPacketsOfTurn; ++i) {
    if (i != 20) add_packet(coverage, i);
  }
  CHECK(covered(coverage) == 360.0);
  coverage.restart();
  for (int i = 0; i < kPacketsOfTurn; ++i) {
    if (i < 20 || i > 22) add_packet(coverage, i);
  }
  CHECK(covered(coverage) == Approx(360.0 - 3 * kPacketDeg).margin(1.5));
}

TEST_CASE("firings on one side only never surround the sensor", "[azimuth_coverage]") {
  AzimuthCoverage coverage;
  // Every fifth packet of a half circle.
  for (int i = 0; i < kPacketsOfTurn / 2; i += 5) add_packet(coverage, i);
  CHECK(covered(coverage) < 190.0);
}

TEST_CASE("the blind sector is no part of the field of view", "[azimuth_coverage]") {
  BlindSector blind;
  blind.on_gap_inside_packet(9000, 27000);
  AzimuthCoverage coverage;
  for (int azimuth = 27000; azimuth <= 36000 + 9000; azimuth += 40)
    coverage.add(static_cast<std::uint16_t>(azimuth % 36000), kStep);
  CHECK(covered(coverage, blind) == Approx(180.0).margin(1.0));
  // 90 degrees of it missing.
  coverage.restart();
  for (int azimuth = 36000; azimuth <= 36000 + 9000; azimuth += 40)
    coverage.add(static_cast<std::uint16_t>(azimuth % 36000), kStep);
  CHECK(covered(coverage, blind) == Approx(91.0).margin(1.0));
}
