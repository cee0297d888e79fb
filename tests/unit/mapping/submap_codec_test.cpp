#include "mapping/submap_codec.hpp"

#include <cmath>
#include <numbers>
#include <random>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::mapping;

Submap sample_submap() {
  Submap submap;
  submap.id = 17;
  submap.T_odom_submap.translation = {1000.5, -20.0, 3.0};
  for (int i = 0; i < 5; ++i) {
    SubmapKeyframe keyframe;
    keyframe.stamp = {1'700'000'000'000'000'000 + i};
    keyframe.T_submap_base = {core::so3_exp({0.0, 0.01, 0.1 * i}), {1.0 * i, 0.5, -0.25}};
    for (std::size_t k = 0; k < keyframe.covariance.size(); ++k)
      keyframe.covariance[k] = 1e-4F * static_cast<float>(k);
    submap.keyframes.push_back(keyframe);
  }
  std::mt19937 random(5);
  std::uniform_real_distribution<float> place(-60.0F, 60.0F);
  std::normal_distribution<float> direction;
  for (int i = 0; i < 2000; ++i) {
    Surface surface;
    surface.mean = {place(random), place(random), 0.1F * place(random)};
    surface.normal = Eigen::Vector3f(direction(random), direction(random), direction(random)).normalized();
    surface.thickness_m = 0.001F + 0.02F * std::abs(direction(random));
    surface.intensity = std::floor(std::abs(place(random)));
    surface.points = 1U + static_cast<std::uint32_t>(random() % 5000U);
    surface.keyframe = static_cast<std::uint16_t>(i % 5);
    surface.is_plane = i % 3 != 0;
    submap.surfaces.push_back(surface);
  }
  return submap;
}

/// The surface of `submap` nearest to `surface`, of the same kind.
const Surface& nearest(const Submap& submap, const Surface& surface) {
  const Surface* best = nullptr;
  for (const Surface& other : submap.surfaces) {
    if (other.is_plane != surface.is_plane) continue;
    if (best == nullptr || (other.mean - surface.mean).norm() < (best->mean - surface.mean).norm())
      best = &other;
  }
  return *best;
}

}  // namespace

TEST_CASE("a submap is the same after encoding and decoding, within the documented steps", "[submap_codec]") {
  const Submap submap = sample_submap();
  const MapId map{1, 2, 3};
  const Bytes bytes = encode_submap(submap, map, {42});
  const auto decoded = decode_submap(bytes, "x.sub");
  REQUIRE(decoded.ok());
  CHECK(decoded->map == map);
  CHECK(decoded->created.ns == 42);
  const Submap& copy = decoded->submap;
  CHECK(copy.id == 17);
  CHECK(copy.T_odom_submap.translation == submap.T_odom_submap.translation);
  REQUIRE(copy.keyframes.size() == 5);
  for (std::size_t i = 0; i < 5; ++i) {
    CHECK(copy.keyframes[i].stamp.ns == submap.keyframes[i].stamp.ns);
    CHECK(copy.keyframes[i].T_submap_base.translation == submap.keyframes[i].T_submap_base.translation);
    CHECK(copy.keyframes[i].T_submap_base.rotation.coeffs() ==
          submap.keyframes[i].T_submap_base.rotation.coeffs());
    CHECK(copy.keyframes[i].covariance == submap.keyframes[i].covariance);
  }
  REQUIRE(copy.surfaces.size() == submap.surfaces.size());
  double worst_mean = 0.0;
  double worst_angle = 0.0;
  for (const Surface& surface : submap.surfaces) {
    const Surface& other = nearest(copy, surface);
    const double step = surface.is_plane ? 0.5 / 256.0 : 1.0 / 256.0;
    worst_mean = std::max(worst_mean, (other.mean - surface.mean).cwiseAbs().maxCoeff() / step);
    worst_angle = std::max(worst_angle, std::acos(std::min<double>(other.normal.dot(surface.normal), 1.0)));
    CHECK(other.thickness_m == Approx(surface.thickness_m).epsilon(0.02));
    CHECK(other.intensity == surface.intensity);
    CHECK(other.points == Approx(surface.points).epsilon(0.02));
    CHECK(other.keyframe == surface.keyframe);
  }
  CHECK(worst_mean < 0.6);
  CHECK(worst_angle < 1.2 * std::numbers::pi / 180.0);
  CHECK(bytes.size() < submap.surfaces.size() * 14 + 5 * 160 + 200);
}

TEST_CASE("the projection of normals is exact along the axes and unbiased everywhere", "[submap_codec]") {
  for (int axis = 0; axis < 3; ++axis) {
    for (const float sign : {-1.0F, 1.0F}) {
      const Eigen::Vector3f normal = sign * Eigen::Vector3f::Unit(axis);
      CHECK(decode_normal(encode_normal(normal)).dot(normal) > 0.99995);
    }
  }
  CHECK(decode_normal(encode_normal(Eigen::Vector3f::Zero())).norm() == Approx(1.0));
}

TEST_CASE("every damage of a submap file is detected", "[submap_codec]") {
  Submap submap = sample_submap();
  submap.surfaces.resize(20);
  const Bytes good = encode_submap(submap, {}, {});
  REQUIRE(decode_submap(good, "x").ok());
  for (std::size_t length = 0; length < good.size(); ++length)
    REQUIRE_FALSE(decode_submap(std::span(good).first(length), "x").ok());
  for (std::size_t at = 0; at < good.size(); ++at) {
    Bytes bad = good;
    bad[at] ^= 0x10U;
    // The tag of a section is not covered by a checksum: the section is then missing.
    REQUIRE_FALSE(decode_submap(bad, "x").ok());
  }
}

TEST_CASE("a file of a newer format says so", "[submap_codec]") {
  using Catch::Matchers::Contains;
  CHECK_THAT(decode_submap(Bytes(100, 0), "a.sub").error().message, Contains("a.sub") && Contains("magic"));
}
