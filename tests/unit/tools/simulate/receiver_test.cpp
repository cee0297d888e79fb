#include "tools/simulate/sensors/receiver.hpp"

#include "tests/support/tools/simulate_room.hpp"
#include "tools/simulate/random.hpp"

#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools::simulate;
using drivers::VelodyneModel;

namespace {

Effects only(std::initializer_list<Effect> list) {
  Effects effects;
  for (const Effect effect : list) effects.add(effect);
  return effects;
}

PartialHit surface(double range_m, double share, Material material = Material::kPlaster,
                   double cosine = 1.0) {
  PartialHit part;
  part.hit.hit = true;
  part.hit.distance_m = static_cast<float>(range_m);
  part.hit.incidence_cosine = static_cast<float>(cosine);
  part.hit.material = material;
  part.share = share;
  return part;
}

/// Receiver of a VLP-16 without noise, and its shots.
class Bench {
 public:
  explicit Bench(Effects effects, const Weather& weather = {}, Realism realism = Realism::kTypical)
      : sensor_(drivers::make_velodyne_sensor(VelodyneModel::kVlp16)),
        beam_(sensor_.lasers[7], sensor_.vertical_offset_across_beam),
        receiver_(sensor_, LidarErrors(sensor_, realism, effects, 1), weather, 0.0) {}

  [[nodiscard]] std::vector<double> ranges(const std::vector<PartialHit>& parts, std::uint64_t shot = 0,
                                           double transmission = 1.0) const {
    ReceivedShot received;
    received.nominal = &beam_;
    received.laser = 7;
    received.azimuth = BeamAzimuth::of(0.3);
    received.word = random_word(99, shot);
    received.transmission = transmission;
    const Returns returns = receiver_.receive(parts, received);
    std::vector<double> found;
    for (std::size_t i = 0; i < returns.count; ++i) found.push_back(returns.echoes[i].range_m);
    return found;
  }
  /// Share of `shots` that give an echo nearer than `limit_m`.
  [[nodiscard]] double share(const std::vector<PartialHit>& parts, std::uint64_t shots,
                             double limit_m = 1e9) const {
    std::uint64_t count = 0;
    for (std::uint64_t i = 0; i < shots; ++i) {
      const std::vector<double> found = ranges(parts, i);
      if (!found.empty() && found.front() < limit_m) ++count;
    }
    return static_cast<double>(count) / static_cast<double>(shots);
  }

 private:
  drivers::VelodyneSensor sensor_;
  LidarBeam beam_;
  Receiver receiver_;
};

/// Ranges of all returns of a stationary sensor's first packets.
std::vector<double> ranges_in(const TriangleMesh& mesh, Effects effects) {
  std::vector<core::SE3> poses(20);
  const VehicleTrajectory trajectory(poses, kControlIntervalS);
  const auto scene = RayScene::create(mesh, {});
  REQUIRE(scene.ok());
  LidarModelConfig config;
  config.start = tests::kRoomStart;
  config.range_noise_m = 0.0;
  config.realism = Realism::kTypical;
  config.effects = effects;
  const LidarModel model(drivers::make_velodyne_sensor(VelodyneModel::kHdl64eS2), config, trajectory, *scene);
  std::vector<double> ranges;
  for (std::uint64_t i = 0; i < model.packet_count(); ++i) {
    const auto packet = drivers::decode(model.make_packet(i).payload);
    REQUIRE(packet);
    for (const auto& block : packet->blocks) {
      for (const auto& entry : block.entries)
        if (entry.distance > 0) ranges.push_back(entry.distance * model.sensor().distance_resolution_m);
    }
  }
  return ranges;
}

std::size_t count_between(const std::vector<double>& values, double low, double high) {
  return static_cast<std::size_t>(
      std::count_if(values.begin(), values.end(), [&](double v) { return v > low && v < high; }));
}

}  // namespace

TEST_CASE("surfaces within one pulse merge to a mixed point between them, others give two echoes",
          "[receiver]") {
  const Bench bench(only({Effect::kFootprint}));
  const auto merged = bench.ranges({surface(10.0, 0.75), surface(10.4, 0.25)});
  REQUIRE(merged.size() == 1);
  // The mean by received light.
  CHECK(merged[0] == Approx(10.1).margin(0.01));
  const auto apart = bench.ranges({surface(12.0, 0.4), surface(10.0, 0.6)});
  REQUIRE(apart.size() == 2);
  // A partial echo crosses the threshold later, 0.1 m for each natural logarithm of its share.
  CHECK(apart[0] == Approx(10.0 - 0.1 * std::log(0.6)).margin(0.01));
  CHECK(apart[1] == Approx(12.0 - 0.1 * std::log(0.4)).margin(0.01));
  CHECK(bench.ranges({surface(10.0, 1.0)}).front() == Approx(10.0).margin(1e-5));
}

TEST_CASE("a small part of a footprint is seen near by and below the threshold far away", "[receiver]") {
  const Bench bench(only({Effect::kFootprint}));
  CHECK(bench.ranges({surface(10.0, 0.03), surface(15.0, 0.97)}, 1).size() == 2);
  CHECK(bench.ranges({surface(80.0, 0.03), surface(85.0, 0.97)}, 1).size() == 1);
}

TEST_CASE("foreign light gives ghosts at any range, in three of 100,000 shots, one of 1000 if poor",
          "[receiver]") {
  const std::vector<PartialHit> wall{surface(30.0, 1.0)};
  const Bench typical(only({Effect::kGhosts}));
  const Bench poor(only({Effect::kGhosts}), {}, Realism::kPoor);
  std::vector<double> ghosts;
  for (std::uint64_t i = 0; i < 400'000; ++i) {
    const auto found = typical.ranges(wall, i);
    REQUIRE(found.size() == 1);
    if (std::abs(found[0] - 30.0) > 0.01) ghosts.push_back(found[0]);
  }
  CHECK(ghosts.size() > 2);
  CHECK(ghosts.size() < 30);
  std::size_t many = 0;
  double mean = 0.0;
  for (std::uint64_t i = 0; i < 100'000; ++i) {
    const auto found = poor.ranges(wall, i);
    if (std::abs(found.at(0) - 30.0) < 0.01) continue;
    CHECK(found[0] >= 2.0);
    CHECK(found[0] <= 100.0);
    mean += found[0];
    ++many;
  }
  CHECK(static_cast<double>(many) == Approx(100.0).epsilon(0.4));
  CHECK(mean / static_cast<double>(many) == Approx(51.0).margin(10.0));
  // Ghosts appear also where nothing reflects.
  CHECK(poor.share({}, 100'000) == Approx(0.001).epsilon(0.4));
  CHECK(Bench(Effects::none()).share({}, 10'000) == 0.0);
}

TEST_CASE("rain adds near drops and hides wet ground, fog and dust shorten the sight", "[receiver]") {
  const Effects real = only({Effect::kDetection});
  const auto weather = [](const char* text) { return parse_weather(text).value(); };
  const std::vector<PartialHit> wall{surface(30.0, 1.0)};
  CHECK(Bench(real).share(wall, 20'000, 25.0) == 0.0);
  // About 0.3 % of the shots at 10 mm/h, within 12 m.
  const Bench rain(real, weather("rain=10"));
  CHECK(rain.share(wall, 20'000, 12.5) == Approx(0.003).epsilon(0.4));
  CHECK(rain.share(wall, 2'000) > 0.97);

  // Flat wet asphalt 25 m away.
  const std::vector<PartialHit> ground{surface(25.0, 1.0, Material::kAsphalt, 0.07)};
  CHECK(Bench(real).share(ground, 5'000) > Bench(real, weather("wet")).share(ground, 5'000) + 0.05);
  CHECK(Bench(real, weather("wet")).share(wall, 2'000) > 0.97);

  // Two-way attenuation at 60 m in a visibility of 50 m: exp(-2 ln 20 * 60 / 50) = 0.08 %.
  const std::vector<PartialHit> far{surface(60.0, 1.0)};
  CHECK(Bench(real).share(far, 2'000) > 0.9);
  CHECK(Bench(real, weather("fog=50")).share(far, 2'000, 100.0) < 0.1);
  CHECK(Bench(real, weather("dust=50")).share(wall, 20'000, 16.0) >
        3.0 * Bench(real, weather("fog=50")).share(wall, 20'000, 16.0));
}

TEST_CASE("weather that does not exist is refused with the choices", "[receiver]") {
  for (const char* bad : {"snow", "rain", "rain=", "rain=-1", "rain=300", "rain=10mm", "fog=5", "dust=nan"}) {
    INFO(bad);
    const auto weather = parse_weather(bad);
    REQUIRE_FALSE(weather);
    CHECK_THAT(weather.error().message, Catch::Contains("fog=VISIBILITY_M"));
  }
}

TEST_CASE("dirt on the window costs range", "[receiver]") {
  const Bench bench(only({Effect::kDetection}));
  CHECK(bench.ranges({surface(5.0, 1.0)}, 1, 0.02).size() == 1);
  CHECK(bench.ranges({surface(60.0, 1.0)}, 1, 0.02).empty());
}

TEST_CASE("a retroreflector has a halo beside it and before what is farther, never before what is nearer",
          "[receiver]") {
  const auto scene_with = [](double wall_m) {
    TriangleMesh mesh;
    mesh.add_box({}, {15.0, -0.3, -0.9}, {15.05, 0.3, -0.3}, Material::kRetroreflector);
    mesh.add_box({}, {wall_m, -8.0, -3.0}, {wall_m + 0.1, 8.0, 3.0}, Material::kPlaster);
    return mesh;
  };
  const auto plain = ranges_in(scene_with(40.0), only({Effect::kFootprint}));
  const auto halo = ranges_in(scene_with(40.0), only({Effect::kFootprint, Effect::kRetro}));
  const std::size_t sign = count_between(plain, 14.5, 15.6);
  REQUIRE(sign > 20);
  CHECK(count_between(halo, 14.5, 15.6) > sign + sign / 10);
  CHECK(count_between(halo, 14.5, 15.6) < 3 * sign);
  // A wall in front of the sign hides the sign and has no halo.
  CHECK(count_between(ranges_in(scene_with(10.0), only({Effect::kRetro})), 14.5, 15.6) == 0);
}
