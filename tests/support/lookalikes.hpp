#pragma once

#include "tests/support/scanned_world.hpp"

#include <map>
#include <random>
#include <string>
#include <vector>

namespace nilio::tests {

/// World with places that look alike, and a path through it.
struct Lookalike {
  ScannedWorld world;
  std::vector<PathPoint> path;
};

inline std::map<std::string, Lookalike> lookalikes(std::uint32_t seed) {
  std::mt19937 random(seed);
  std::map<std::string, Lookalike> all;

  ScannedWorld houses;
  for (double x = -60.0; x < 500.0; x += 16.0) {
    houses.add_box({x, 8.0}, {x + 10.0, 18.0}, 6.0);
    houses.add_box({x + 3.0, -18.0}, {x + 13.0, -8.0}, 6.0);
  }
  all["rows of equal houses"] = {houses, {{{0, 0}}, {{440, 0}}}};

  ScannedWorld estate;
  for (double x = 8.0; x < 390.0; x += 16.0) {
    for (const double y : {-18.0, 8.0, 78.0, 104.0}) estate.add_box({x, y}, {x + 10.0, y + 10.0}, 6.0);
  }
  all["an estate of equal houses"] = {estate,
                                      {{{0, 0}}, {{400, 0}}, {{400, 96}}, {{0, 96}}, {{0, 0}}, {{200, 0}}}};

  // Corridors of 3 m with equal niches, 12 m apart, connected at their ends.
  ScannedWorld corridors;
  corridors.ceiling_m = 2.6;
  for (double y = 0.0; y < 30.0; y += 12.0) {
    for (double x = 3.0; x < 117.0; x += 6.0) {
      for (const double side : {-1.0, 1.0}) {
        corridors.walls.push_back({{x, y + side * 1.5}, {x + 5.0, y + side * 1.5}, 2.6});
        corridors.walls.push_back({{x + 5.0, y + side * 1.5}, {x + 5.0, y + side * 2.0}, 2.6});
        corridors.walls.push_back({{x + 5.0, y + side * 2.0}, {x + 6.0, y + side * 2.0}, 2.6});
        corridors.walls.push_back({{x + 6.0, y + side * 2.0}, {x + 6.0, y + side * 1.5}, 2.6});
      }
    }
  }
  corridors.walls.push_back({{-3, -5}, {-3, 30}, 2.6});
  corridors.walls.push_back({{123, -5}, {123, 30}, 2.6});
  all["parallel corridors"] = {corridors,
                               {{{0, 0}}, {{120, 0}}, {{120, 12}}, {{0, 12}}, {{0, 24}}, {{120, 24}}}};

  // The same pillars and walls on each storey of 3 m.
  ScannedWorld garage;
  garage.ceiling_m = 2.6;
  garage.add_box({-8, -8}, {58, 38}, 2.6);
  std::uniform_real_distribution<double> shift(-0.5, 0.5);
  for (double x = 0.0; x < 55.0; x += 8.0) {
    for (double y = 6.0; y < 30.0; y += 9.0) {
      const Vector2d p(x + shift(random), y + shift(random));
      garage.add_box(p, p + Vector2d(0.6, 0.6), 2.6);
    }
  }
  std::vector<PathPoint> storeys;
  for (int storey = 0; storey < 3; ++storey) {
    for (const Vector2d& p : {Vector2d{0, 0}, {50, 0}, {50, 32}, {0, 32}, {0, 10}})
      storeys.push_back({p, 3.0 * storey});
  }
  all["storeys"] = {garage, storeys};

  ScannedWorld tunnel;
  tunnel.ceiling_m = 6.0;
  for (const double y : {-5.0, 5.0}) tunnel.walls.push_back({{-100, y}, {600, y}, 6.0});
  all["tunnel"] = {tunnel, {{{0, 0}}, {{400, 0}}}};

  // Equal buildings at two crossings 300 m apart, and little between them.
  ScannedWorld crossings;
  for (const double x : {50.0, 350.0}) {
    std::mt19937 same(seed);
    for (int i = 0; i < 14; ++i) {
      std::uniform_real_distribution<double> along(-40.0, 40.0);
      std::uniform_real_distribution<double> size(2.0, 8.0);
      const double side = i % 2 == 0 ? 1.0 : -1.0;
      const Vector2d p(x + along(same), side * (6.0 + size(same)));
      const Vector2d extent(size(same), size(same));
      crossings.add_box(p - 0.5 * extent, p + 0.5 * extent, size(same));
    }
  }
  all["two crossings"] = {crossings, {{{0, 0}}, {{420, 0}}}};
  return all;
}

}  // namespace nilio::tests
