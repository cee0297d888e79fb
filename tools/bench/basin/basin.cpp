#include "tools/bench/basin/basin.hpp"

#include "daemon/config/terms.hpp"
#include "tools/bench/basin/basin_trial.hpp"
#include "tools/bench/odometry/options.hpp"
#include "tools/bench/results_page.hpp"
#include "tools/commands/number_between.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <variant>

namespace nilio::tools {

namespace {

using core::Result;

constexpr std::array<double, 7> kTranslationsMetres = {0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0};
constexpr std::array<double, 6> kRotationsDeg = {0.0, 2.5, 5.0, 10.0, 15.0, 20.0};

struct BenchBasinOptions {
  std::vector<std::string> datasets;
  std::vector<std::string> registrations{"all"};
  std::vector<std::string> overrides;
  std::size_t pairs = 200;
  std::uint64_t seed = 1;
  ResultsPage::Options page;
};

/// Every rotation with every translation; the rotation's index counts faster.
std::vector<BasinOffset> all_offsets() {
  std::vector<BasinOffset> offsets;
  for (const double translation : kTranslationsMetres) {
    for (const double rotation : kRotationsDeg) offsets.push_back({translation, rotation});
  }
  return offsets;
}

std::vector<core::RegistrationMethodInfo> chosen_methods(const std::vector<std::string>& names) {
  const auto all = core::registration_methods();
  if (std::find(names.begin(), names.end(), "all") != names.end()) return {all.begin(), all.end()};
  std::vector<core::RegistrationMethodInfo> methods;
  methods.reserve(names.size());
  for (const std::string& name : names) methods.push_back(*core::find_registration_method(name));
  return methods;
}

/// Share of successes [method][translation][rotation].
struct Basin {
  std::vector<core::RegistrationMethodInfo> methods;
  std::vector<std::vector<std::size_t>> counts;
  std::size_t pairs = 0;

  [[nodiscard]] double share(std::size_t method, std::size_t translation, std::size_t rotation) const {
    return static_cast<double>(counts[method][translation * kRotationsDeg.size() + rotation]) /
           static_cast<double>(pairs);
  }
};

BenchTable basin_table(const Basin& basin) {
  BenchTable table{{"registration"}, {}};
  for (std::size_t t = 1; t < kTranslationsMetres.size(); ++t)
    table.headings.push_back(fixed(kTranslationsMetres[t], 1) + " m");
  for (std::size_t r = 1; r < kRotationsDeg.size(); ++r)
    table.headings.push_back(fixed(kRotationsDeg[r], 1) + " deg");
  table.headings.emplace_back("1 m, 5 deg");
  table.headings.emplace_back("all offsets");
  for (std::size_t m = 0; m < basin.methods.size(); ++m) {
    std::vector<std::string> row{basin.methods[m].name};
    for (std::size_t t = 1; t < kTranslationsMetres.size(); ++t)
      row.push_back(fixed(basin.share(m, t, 0), 2));
    for (std::size_t r = 1; r < kRotationsDeg.size(); ++r) row.push_back(fixed(basin.share(m, 0, r), 2));
    row.push_back(fixed(basin.share(m, 2, 2), 2));
    double sum = 0.0;
    for (const std::size_t count : basin.counts[m]) sum += static_cast<double>(count);
    row.push_back(fixed(sum / static_cast<double>(basin.counts[m].size() * basin.pairs), 2));
    table.rows.push_back(std::move(row));
  }
  return table;
}

/// From pale to dark blue.
Colour share_colour(double share) {
  const auto mix = [share](double a, double b) { return a + share * (b - a); };
  return {mix(0.97, 0.10), mix(0.97, 0.36), mix(0.97, 0.56)};
}

void draw_panel(Canvas& canvas, const Basin& basin, std::size_t method, const Rectangle& area, bool first) {
  const double cell_width = area.width / static_cast<double>(kTranslationsMetres.size());
  const double cell_height = area.height / static_cast<double>(kRotationsDeg.size());
  for (std::size_t t = 0; t < kTranslationsMetres.size(); ++t) {
    for (std::size_t r = 0; r < kRotationsDeg.size(); ++r) {
      const double share = basin.share(method, t, r);
      const Rectangle cell{area.x + static_cast<double>(t) * cell_width,
                           area.y + area.height - static_cast<double>(r + 1) * cell_height, cell_width - 1.0,
                           cell_height - 1.0};
      canvas.fill(cell, share_colour(share));
      const Colour ink = share > 0.55 ? Colour{1.0, 1.0, 1.0} : Colour{0.25, 0.25, 0.25};
      canvas.text(fixed(100.0 * share, 0), {cell.x + 0.5 * cell.width, cell.y + 0.5 * cell.height + 4.5},
                  {.size = 13.0, .colour = ink, .align = TextAlign::kCentre});
    }
  }
  const TextStyle tick{.size = 13.0, .align = TextAlign::kCentre};
  for (std::size_t t = 0; t < kTranslationsMetres.size(); ++t) {
    const double x = area.x + (static_cast<double>(t) + 0.5) * cell_width;
    canvas.text(fixed(kTranslationsMetres[t], 1), {x, area.y + area.height + 18.0}, tick);
  }
  canvas.text("offset [m]", {area.x + 0.5 * area.width, area.y + area.height + 40.0},
              {.size = 14.0, .align = TextAlign::kCentre});
  canvas.text(basin.methods[method].name, {area.x, area.y - 12.0}, {.size = 16.0, .bold = true});
  if (!first) return;
  for (std::size_t r = 0; r < kRotationsDeg.size(); ++r) {
    const double y = area.y + area.height - (static_cast<double>(r) + 0.5) * cell_height + 4.5;
    canvas.text(fixed(kRotationsDeg[r], 1), {area.x - 8.0, y}, {.size = 13.0, .align = TextAlign::kRight});
  }
  canvas.text("turned by [deg]", {area.x - 52.0, area.y + 0.5 * area.height},
              {.size = 14.0, .align = TextAlign::kCentre, .vertical = true});
}

void draw_basin(Canvas& canvas, const Basin& basin) {
  canvas.fill({0.0, 0.0, canvas.width(), canvas.height()}, kWhite);
  constexpr double left = 84.0;
  constexpr double right = 20.0;
  constexpr double gap = 26.0;
  constexpr double top = 76.0;
  constexpr double bottom = 60.0;
  canvas.text(
      "Registrations that end at home, %, of " + std::to_string(basin.pairs) + " scan pairs for each offset",
      {left, 34.0}, {.size = 16.0});
  const std::size_t methods = basin.methods.size();
  const double width =
      (canvas.width() - left - right - gap * static_cast<double>(methods - 1)) / static_cast<double>(methods);
  for (std::size_t m = 0; m < methods; ++m) {
    const Rectangle area{left + static_cast<double>(m) * (width + gap), top, width,
                         canvas.height() - top - bottom};
    draw_panel(canvas, basin, m, area, m == 0);
  }
}

Result<std::monostate> report(const std::string& name, const Basin& basin, ResultsPage& page) {
  page.table(name, basin_table(basin));
  if (!page.wants_pictures()) return std::monostate{};
  constexpr int picture_width = 1700;
  constexpr int picture_height = 380;
  const std::string file = "basin-" + name;
  auto canvas = page.new_picture(file, picture_width, picture_height);
  if (!canvas) return canvas.error();
  draw_basin(*canvas, basin);
  return page.picture(file, "Share of registrations that find home, " + name, *canvas);
}

Result<Basin> measure_basin(const BenchDataset& dataset, std::size_t pairs,
                            const BenchBasinOptions& options) {
  const Result<daemon::Config> config = bench_config(dataset, options.overrides);
  if (!config) return config.error();
  const auto collected = collect_pairs(dataset, *config, pairs);
  if (!collected) return collected.error();
  Basin basin{chosen_methods(options.registrations), {}, collected->size()};
  basin.counts = count_successes(basin.methods, *collected, all_offsets(), daemon::odometry_config(*config),
                                 options.seed);
  return basin;
}

Result<std::monostate> run(const BenchBasinOptions& options) {
  std::vector<BenchDataset> datasets;
  for (const std::string& argument : options.datasets) {
    Result<BenchDataset> dataset = open_bench_dataset(argument);
    if (!dataset) return dataset.error();
    datasets.push_back(std::move(dataset).value());
  }
  Result<ResultsPage> page = ResultsPage::create(options.page, "Convergence basin");
  if (!page) return page.error();
  page->paragraph(
      "Each scan is registered against the map of the five before it, from a pose that is wrong by so much: "
      "displaced in a random horizontal direction, turned about the vertical to a random side. Home is "
      "within "
      "0.1 m and 0.5 deg of where the method ends from the odometry's own pose, if that is within 0.3 m and "
      "1 deg of it.");
  Basin sum;
  for (std::size_t i = 0; i < datasets.size(); ++i) {
    const std::size_t left = datasets.size() - i;
    const std::size_t share = (options.pairs - sum.pairs + left - 1) / left;
    const Result<Basin> basin = measure_basin(datasets[i], share, options);
    if (!basin) return basin.error();
    const auto reported = report(datasets[i].name, *basin, *page);
    if (!reported) return reported;
    sum.pairs += basin->pairs;
    if (sum.counts.empty()) {
      sum.methods = basin->methods;
      sum.counts = basin->counts;
      continue;
    }
    for (std::size_t m = 0; m < sum.counts.size(); ++m) {
      for (std::size_t k = 0; k < sum.counts[m].size(); ++k) sum.counts[m][k] += basin->counts[m][k];
    }
  }
  if (datasets.size() > 1) {
    const auto reported = report("all", sum, *page);
    if (!reported) return reported;
  }
  return page->save();
}

}  // namespace

void add_bench_basin(CLI::App& bench) {
  const auto options = std::make_shared<BenchBasinOptions>();
  CLI::App* const command =
      bench.add_subcommand("basin", "From how far away each registration method finds home");
  command
      ->add_option("datasets", options->datasets,
                   "FOLDER of a recording or of a KITTI sequence, with truth.tum or poses.txt in it; or "
                   "FOLDER:TRUTH")
      ->required();
  std::vector<std::string> names;
  for (const core::RegistrationMethodInfo& method : core::registration_methods())
    names.emplace_back(method.name);
  names.emplace_back("all");
  command->add_option("--registration", options->registrations, "methods to compare, or 'all'")
      ->delimiter(',')
      ->check(CLI::IsMember(names))
      ->capture_default_str();
  constexpr double most_pairs = 100000;
  command->add_option("--pairs", options->pairs, "scans to try, shared among the data sets")
      ->check(number_between(1, most_pairs))
      ->capture_default_str();
  command->add_option("--seed", options->seed, "of the directions")->capture_default_str();
  add_override_option(*command, options->overrides, "configuration, such as odometry.coarse_voxel_m=3");
  add_page_options(*command, options->page);
  command->callback([options, command] { end_bench(*command, run(*options)); });
}

}  // namespace nilio::tools
