#include "tools/simulate/town/town.hpp"

#include "tools/simulate/random.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

constexpr double kPavementWidthM = 2.2;
constexpr double kKerbHeightM = 0.12;
constexpr double kPi = std::numbers::pi;
/// Two visits differ in 2 p (1 - p) of the objects.
constexpr double kMissingShare = 0.113;

/// Side of the driven path.
enum class Side { kRight, kLeft };

double sign_of(Side side) { return side == Side::kLeft ? 1.0 : -1.0; }

double edge_of(const StreetSample& sample, Side side) {
  return side == Side::kLeft ? sample.left_edge_m : sample.right_edge_m;
}

/// Heading along the street with the plot on the left hand, so that a front facing -y faces the street.
double front_yaw(const StreetSample& sample, Side side) {
  return side == Side::kLeft ? sample.yaw_rad : sample.yaw_rad + kPi;
}

/// Places objects on the free cells of a layout, one kind after the other.
class TownBuilder {
 public:
  TownBuilder(Town& town, const TownConfig& config) : town_(town), config_(config) {}

  void build() {
    town_.ground.append_to(town_.mesh, town_.layout, config_.clutter);
    for (const Side side : {Side::kRight, Side::kLeft}) {
      add_pavement(side);
      add_parked_cars(side);
      add_buildings(side, 0.0, 5.0);
    }
    for (const Side side : {Side::kRight, Side::kLeft}) {
      add_posts(side);
      add_street_trees(side);
      add_garden_plants(side);
      add_buildings(side, 18.0, 40.0);
      // Last, so that the rest of the town is the same without.
      if (config_.clutter) {
        add_boundaries(side);
        add_shrubs(side);
        add_pavement_clutter(side);
      }
    }
    if (config_.clutter) add_wires();
  }

 private:
  using Random = RandomStream;

  [[nodiscard]] const std::vector<StreetSample>& samples() const { return town_.layout.samples(); }
  [[nodiscard]] Random random_for(std::uint64_t kind, Side side) const {
    return {config_.seed, 100 + 10 * kind + (side == Side::kLeft ? 1 : 0)};
  }

  /// `chance` of an object, scaled by the density.
  [[nodiscard]] double scaled(double chance) const { return std::min(1.0, chance * config_.density); }

  /// Occupies the footprint if no cell within `margin_m` has one of `uses`.
  bool claim(const Footprint& footprint, std::uint8_t uses, double margin_m) {
    if (!town_.layout.is_free(footprint, static_cast<std::uint8_t>(uses | cell_use::kTaken), margin_m))
      return false;
    town_.layout.mark(footprint, cell_use::kTaken);
    return true;
  }

  /// Where to put the next object: it may be missing at this visit. Its place is taken all the same, so that
  /// the rest of the town does not change.
  [[nodiscard]] TriangleMesh& mesh() {
    const bool is_missing =
        config_.visit && to_unit_interval(random_word(*config_.visit, 61, objects_++)) < kMissingShare;
    if (!is_missing) return town_.mesh;
    missing_ = {};
    // Plants of both kinds draw different numbers.
    missing_.porous_plants = town_.mesh.porous_plants;
    return missing_;
  }

  /// Upright frame on the ground.
  [[nodiscard]] SE3 frame_at(const Vector2& p, double yaw_rad) const {
    return upright_frame(town_.ground.on_ground(p), yaw_rad);
  }

  void add_pavement(Side side) {
    // Kerb face, then a slab down to the ground at its far side.
    for (std::size_t i = 0; i + 1 < samples().size(); ++i) {
      const StreetSample& a = samples()[i];
      const StreetSample& b = samples()[i + 1];
      const double edge = edge_of(a, side);
      const bool folds = sign_of(side) * a.curvature * (edge + kPavementWidthM) > 0.85;
      if (!a.first_pass || folds || edge != edge_of(b, side)) continue;
      const Vector2 outside = a.beside(sign_of(side) * (edge + 1.2));
      if ((town_.layout.use_at(outside) & cell_use::kRoad) != 0) continue;
      const auto at = [&](const StreetSample& sample, double out, double up) {
        Vector3 p = town_.ground.on_ground(sample.beside(sign_of(side) * (edge + out)));
        p.z() += up;
        return p;
      };
      town_.mesh.add_quad(at(a, 0, -0.3), at(b, 0, -0.3), at(b, 0, kKerbHeightM), at(a, 0, kKerbHeightM),
                          Material::kPavement);
      town_.mesh.add_quad(at(a, 0, kKerbHeightM), at(b, 0, kKerbHeightM),
                          at(b, kPavementWidthM, kKerbHeightM), at(a, kPavementWidthM, kKerbHeightM),
                          Material::kPavement);
      town_.mesh.add_quad(at(a, kPavementWidthM, -0.3), at(b, kPavementWidthM, -0.3),
                          at(b, kPavementWidthM, kKerbHeightM), at(a, kPavementWidthM, kKerbHeightM),
                          Material::kPavement);
    }
  }

  void add_parked_cars(Side side) {
    Random random(config_.visit.value_or(config_.seed), side == Side::kLeft ? 111 : 110);
    std::array<TriangleMesh, kCarModels> cars;
    for (std::size_t model = 0; model < kCarModels; ++model) cars[model] = make_car(model);
    for_each_place(side, 5.2, 0.3, random, [&](const StreetSample& sample) {
      const double strip = edge_of(sample, side);
      const double lane = side == Side::kLeft ? 5.6 : 2.3;
      if (strip < lane + 1.0 || !random.chance(scaled(0.65))) return;
      const std::size_t model = random.index(kCarModels);
      const CarSize size = car_size(model);
      const double turned = front_yaw(sample, side) + kPi + 0.02 * random.gaussian();
      const Footprint footprint{sample.beside(sign_of(side) * (lane + 1.05 + random.uniform(-0.1, 0.1))),
                                turned, size.length_m, size.width_m};
      if (!claim(footprint, cell_use::kLane, 0.0)) return;
      town_.mesh.append(cars[model], frame_at(footprint.centre, turned));
      ++town_.summary.parked_cars;
    });
  }

  /// Rows of plots along one side, `setback_min` to `setback_max` behind the pavement.
  void add_buildings(Side side, double setback_min_m, double setback_max_m) {
    Random random = random_for(setback_min_m > 0.0 ? 3 : 2, side);
    double street_setback = random.uniform(setback_min_m, setback_max_m);
    std::size_t i = 0;
    while (i < samples().size()) {
      const double length = random.uniform(8.0, 24.0);
      const BuildingPlan plan = random_building_plan(length, random.uniform(8.0, 15.0), random);
      const BuildingPlan small = random_building_plan(random.uniform(6.5, 9.0), 7.0, random);
      const double turned = random.chance(0.08) ? random.uniform(-0.3, 0.3) : 0.02 * random.gaussian();
      if (random.chance(0.15)) street_setback = random.uniform(setback_min_m, setback_max_m);
      double built = 0.0;
      if (random.chance(scaled(0.9))) {
        if (place_building(i, side, street_setback, turned, plan, random)) {
          built = plan.length_m;
        } else if (place_building(i, side, street_setback, turned, small, random)) {
          built = small.length_m;
        }
      }
      // Detached houses keep at least 3 m to the boundary of their plot (German building codes).
      const double least = config_.clutter ? 6.0 : 1.5;
      const double most = config_.clutter ? 9.0 : 7.0;
      const double gap = random.chance(0.4) ? 0.8 : random.uniform(least, most);
      i += static_cast<std::size_t>((built > 0.0 ? built + gap : 3.0) / kSampleSpacingM);
    }
  }

  /// Builds with the front starting at a sample.
  bool place_building(std::size_t first, Side side, double setback_m, double turned, const BuildingPlan& plan,
                      Random& random) {
    const std::size_t middle = first + static_cast<std::size_t>(0.5 * plan.length_m / kSampleSpacingM);
    if (middle >= samples().size() || !samples()[middle].first_pass) return false;
    const StreetSample& sample = samples()[middle];
    const double out = edge_of(sample, side) + kPavementWidthM + setback_m + 0.5 * plan.depth_m;
    const double yaw = front_yaw(sample, side) + turned;
    const Footprint footprint{sample.beside(sign_of(side) * out), yaw, plan.length_m, plan.depth_m};
    // Space for pavement and balconies.
    if (!town_.layout.is_free(footprint, cell_use::kRoad, 1.8) || !claim(footprint, 0, 0.3)) return false;
    const double z = town_.ground.lowest(footprint);
    add_building(town_.mesh, upright_frame({footprint.centre.x(), footprint.centre.y(), z}, yaw), plan);
    ++town_.summary.buildings;
    if (setback_m > 1.5 && random.chance(scaled(0.5)))
      add_garden_wall(sample, side, yaw, plan.length_m, random);
    return true;
  }

  void add_garden_wall(const StreetSample& sample, Side side, double yaw, double length_m, Random& random) {
    const double out = edge_of(sample, side) + kPavementWidthM + 0.4;
    const Footprint footprint{sample.beside(sign_of(side) * out), yaw, 0.75 * length_m, 0.25};
    const double height = random.uniform(0.5, 1.6);
    if (!claim(footprint, cell_use::kRoad, 0.2)) return;
    const double z = town_.ground.lowest(footprint);
    mesh().add_box(upright_frame({footprint.centre.x(), footprint.centre.y(), z}, yaw),
                   {-0.5 * footprint.length_m, -0.12, -1.0}, {0.5 * footprint.length_m, 0.12, height},
                   Material::kBrick);
    ++town_.summary.walls;
  }

  void add_posts(Side side) {
    Random random = random_for(4, side);
    for_each_place(side, 22.0, 6.0, random, [&](const StreetSample& sample) {
      const double out = edge_of(sample, side) + 1.1;
      const bool lamp = random.chance(0.7);
      const Footprint footprint{sample.beside(sign_of(side) * out), sample.yaw_rad, 0.3, 0.3};
      if (!random.chance(scaled(0.9)) || !claim(footprint, cell_use::kRoad, 0.0)) return;
      const double yaw = front_yaw(sample, side);
      if (lamp) {
        add_lamp(mesh(), frame_at(footprint.centre, yaw - 0.5 * kPi), random);
      } else {
        add_sign(mesh(), frame_at(footprint.centre, yaw + kPi), random);
      }
      ++town_.summary.posts;
    });
  }

  void add_street_trees(Side side) {
    Random random = random_for(5, side);
    for_each_place(side, 8.0, 5.0, random, [&](const StreetSample& sample) {
      if (!random.chance(scaled(0.6))) return;
      const double out = edge_of(sample, side) + random.uniform(1.5, 2.1);
      plant_tree(sample.beside(sign_of(side) * out), random.uniform(1.0, 2.3), random);
    });
  }

  void add_garden_plants(Side side) {
    Random random = random_for(6, side);
    for_each_place(side, 3.0, 1.5, random, [&](const StreetSample& sample) {
      const double out = edge_of(sample, side) + kPavementWidthM + random.uniform(1.0, 22.0);
      const Vector2 place = sample.beside(sign_of(side) * out);
      if (random.chance(scaled(0.25))) {
        plant_tree(place, random.uniform(1.2, 3.4), random);
      } else if (random.chance(scaled(0.35))) {
        plant_bush(place, random.uniform(0.4, 1.2), random);
      }
    });
  }

  /// Hedges and fences between pavement and gardens.
  void add_boundaries(Side side) {
    Random random = random_for(7, side);
    for_each_place(side, 5.0, 4.0, random, [&](const StreetSample& sample) {
      const double length = random.uniform(4.0, 10.0);
      const double height = random.uniform(0.8, 2.0);
      const double out = edge_of(sample, side) + kPavementWidthM + random.uniform(0.4, 1.2);
      const bool hedge = random.chance(0.6);
      if (!random.chance(scaled(0.85))) return;
      const Footprint footprint{sample.beside(sign_of(side) * out), sample.yaw_rad, length,
                                hedge ? 0.7 : 0.1};
      if (!claim(footprint, cell_use::kRoad, 0.0)) return;
      const SE3 frame = upright_frame(
          {footprint.centre.x(), footprint.centre.y(), town_.ground.lowest(footprint)}, sample.yaw_rad);
      if (hedge) {
        add_hedge(mesh(), frame, length, height);
      } else {
        add_fence(mesh(), frame, length, height);
      }
      ++town_.summary.clutter;
    });
  }

  /// Loose shrubs in the front gardens.
  void add_shrubs(Side side) {
    Random random = random_for(10, side);
    for_each_place(side, 3.0, 2.0, random, [&](const StreetSample& sample) {
      const double out = edge_of(sample, side) + kPavementWidthM + random.uniform(0.6, 6.0);
      const double radius = random.uniform(0.5, 1.3);
      if (!random.chance(scaled(0.7))) return;
      plant_bush(sample.beside(sign_of(side) * out), radius, random);
    });
  }

  void add_pavement_clutter(Side side) {
    Random random = random_for(8, side);
    for_each_place(side, 5.0, 8.0, random, [&](const StreetSample& sample) {
      const double out = edge_of(sample, side) + random.uniform(1.2, 3.2);
      if (!random.chance(scaled(0.8))) return;
      const Footprint footprint{sample.beside(sign_of(side) * out), sample.yaw_rad, 1.6, 0.6};
      if (!claim(footprint, cell_use::kRoad, 0.0)) return;
      add_clutter(mesh(), frame_at(footprint.centre, sample.yaw_rad + random.uniform(-0.4, 0.4)), random);
      ++town_.summary.clutter;
    });
  }

  /// Overhead wires across the street and along it.
  void add_wires() {
    Random random = random_for(9, Side::kRight);
    for_each_place(Side::kRight, 30.0, 30.0, random, [&](const StreetSample& sample) {
      if (!random.chance(scaled(0.6))) return;
      const double height = random.uniform(5.5, 7.5);
      const auto end = [&](double left, double ahead) {
        Vector3 p = town_.ground.on_ground(sample.beside(left) + ahead * direction(sample.yaw_rad));
        p.z() += height;
        return p;
      };
      const double right = -sample.right_edge_m - 1.5;
      add_wire(town_.mesh, end(right, 0.0), end(sample.left_edge_m + 1.5, random.uniform(-8.0, 8.0)), 0.3);
      add_wire(town_.mesh, end(right, -15.0), end(right, 15.0), 0.5);
      ++town_.summary.clutter;
    });
  }

  void plant_tree(const Vector2& place, double crown_radius_m, Random& random) {
    const Footprint crown{place, 0.0, 2.0 * crown_radius_m, 2.0 * crown_radius_m};
    if (!town_.layout.is_free(crown, cell_use::kLane, 0.0)) return;
    // Crowns may touch each other and walls; trunks need free ground.
    if (!claim({place, 0.0, 0.8, 0.8}, cell_use::kRoad, 0.4)) return;
    add_tree(mesh(), frame_at(place, random.uniform(0.0, kPi)), crown_radius_m, random);
    ++town_.summary.trees;
  }

  void plant_bush(const Vector2& place, double radius_m, Random& random) {
    if (!claim({place, 0.0, 2.0 * radius_m, 2.0 * radius_m}, cell_use::kRoad, 0.0)) return;
    add_bush(mesh(), frame_at(place, 0.0), radius_m, random);
    ++town_.summary.bushes;
  }

  /// Visits a sample about every `spacing_m` (plus up to `spread_m`) on first passes of a street.
  template <class Visit>
  void for_each_place(Side side, double spacing_m, double spread_m, Random& random, Visit visit) {
    double next = random.uniform(0.0, spacing_m);
    for (std::size_t i = 0; i < samples().size(); ++i) {
      const double travelled = static_cast<double>(i) * kSampleSpacingM;
      const bool folds = sign_of(side) * samples()[i].curvature * edge_of(samples()[i], side) > 0.7;
      if (travelled < next || !samples()[i].first_pass || folds) continue;
      next = travelled + spacing_m + random.uniform(0.0, spread_m);
      visit(samples()[i]);
    }
  }

  Town& town_;
  const TownConfig& config_;
  std::uint64_t objects_ = 0;
  TriangleMesh missing_;
};

}  // namespace

core::Result<Town> build_town(const VehicleTrajectory& trajectory, const TownConfig& config) {
  core::Result<StreetLayout> layout = StreetLayout::create(trajectory, config.seed);
  if (!layout) return layout.error();
  Ground ground(*layout, config.seed);
  Town town{std::move(*layout), std::move(ground), {}, {}};
  town.mesh.porous_plants = config.porous_plants;
  TownBuilder(town, config).build();
  return town;
}

}  // namespace nilio::tools::simulate
