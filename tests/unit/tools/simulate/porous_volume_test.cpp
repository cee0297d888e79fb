#include "tools/simulate/geometry/porous_volume.hpp"

#include "tools/simulate/random.hpp"

#include <cmath>

#include <catch2/catch.hpp>

using namespace nilio::tools::simulate;
using Eigen::Vector3f;

namespace {

PorousVolume box(float depth_m, float extinction) {
  PorousVolume volume;
  volume.shape = PorousVolume::Shape::kBox;
  volume.half_size = {0.5F * depth_m, 20.0F, 20.0F};
  volume.extinction = extinction;
  return volume;
}

/// Share of parallel rays along x that a body stops.
double stopped_share(const PorousVolume& volume) {
  RandomStream random(1, 2);
  int stopped = 0;
  constexpr int kRays = 4000;
  for (int i = 0; i < kRays; ++i) {
    const Vector3f origin(-30.0F, static_cast<float>(random.uniform(-15.0, 15.0)),
                          static_cast<float>(random.uniform(-15.0, 15.0)));
    stopped += cast_at_volume(volume, 7, origin, Vector3f::UnitX(), 0.4F, 100.0F) ? 1 : 0;
  }
  return static_cast<double>(stopped) / kRays;
}

}  // namespace

TEST_CASE("light through foliage is lost by Beer and Lambert's law", "[porous_volume]") {
  // A street tree: half of 1 m^2/m^3 of leaf area across the ray.
  CHECK(stopped_share(box(1.0F, 0.5F)) == Approx(1.0 - std::exp(-0.5)).margin(0.03));
  CHECK(stopped_share(box(3.0F, 0.5F)) == Approx(1.0 - std::exp(-1.5)).margin(0.03));
  CHECK(stopped_share(box(1.0F, 2.0F)) == Approx(1.0 - std::exp(-2.0)).margin(0.03));
  CHECK(stopped_share(box(0.04F, 5.6F)) == Approx(0.2).margin(0.03));
}

TEST_CASE("leaves stay in place: another ray or another origin finds the same leaf", "[porous_volume]") {
  PorousVolume crown;
  crown.half_size = {2.0F, 2.0F, 2.0F};
  crown.centre = {10.0F, 0.0F, 0.0F};
  int hits = 0;
  for (int i = 0; i < 200; ++i) {
    const float y = 0.015F * static_cast<float>(i - 100);
    const Vector3f near(5.0F, y, 0.3F);
    const Vector3f far(2.0F, y, 0.3F);
    const auto one = cast_at_volume(crown, 3, near, Vector3f::UnitX(), 0.4F, 100.0F);
    const auto two = cast_at_volume(crown, 3, far, Vector3f::UnitX(), 0.4F, 100.0F);
    REQUIRE(one.has_value() == two.has_value());
    if (!one) continue;
    ++hits;
    CHECK(one->distance_m + 5.0F == Approx(two->distance_m + 2.0F).margin(0.002));
  }
  CHECK(hits > 50);
  CHECK(hits < 200);
}

TEST_CASE("a crown is hit only inside its ellipsoid", "[porous_volume]") {
  PorousVolume crown;
  crown.half_size = {1.0F, 2.0F, 3.0F};
  crown.extinction = 50.0F;
  const auto cast = [&](const Vector3f& origin) {
    return cast_at_volume(crown, 1, origin, Vector3f::UnitX(), 0.4F, 100.0F);
  };
  const auto middle = cast({-10.0F, 0.0F, 0.0F});
  REQUIRE(middle);
  CHECK(middle->distance_m == Approx(9.05).margin(0.1));
  CHECK_FALSE(cast({-10.0F, 2.1F, 0.0F}));
  CHECK_FALSE(cast({10.0F, 0.0F, 0.0F}));
}

TEST_CASE("grass lifts the ground for grazing rays and lets steep ones through", "[porous_volume]") {
  constexpr float kHeight = 0.08F;
  const auto lifted = [&](float sine) {
    double sum = 0.0;
    int count = 0;
    const Vector3f direction(std::sqrt(1.0F - sine * sine), 0.0F, -sine);
    for (int i = 0; i < 500; ++i) {
      const Vector3f origin(0.1F * static_cast<float>(i), 0.3F * static_cast<float>(i), 1.7F);
      const float ground = 1.7F / sine;
      const auto blade = cast_at_grass(origin, direction, ground, sine, kHeight);
      sum += blade ? static_cast<double>((ground - *blade) * sine) : 0.0;
      ++count;
    }
    return sum / count;
  };
  CHECK(lifted(0.05F) > 0.02);
  CHECK(lifted(0.05F) < 0.08);
  CHECK(lifted(0.9F) < lifted(0.05F));
}
