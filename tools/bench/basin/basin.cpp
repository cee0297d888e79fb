#include "daemon/config/convert.hpp"
#include "tools/bench/basin/trials.hpp"
#include "tools/bench/bench.hpp"

#include <algorithm>
#include <array>
#include <cstdio>
#include <variant>

namespace nilio::tools::bench {

namespace {

using core::Result;

constexpr std::array<double, 7> kTranslationsMetres = {0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0};
constexpr std::array<double, 6> kRotationsDeg = {0.0, 2.5, 5.0, 10.0, 15.0, 20.0};
constexpr int kPictureWidth = 1600;
constexpr int kPictureHeight = 520;
constexpr const char* kLegend =
    "Each scan is registered against the map of the five scans before it, from an initial pose with an "
    "error: "
    "displaced in a random horizontal direction and turned about the vertical axis to a random side. "
    "Success: "
    "the method ends within 0.1 m and 0.5 deg of its result from the odometry's pose, and that result is "
    "within 0.3 m and 1 deg of the odometry's pose. Tables show the share of successes.";

/// Every translation with every rotation; the index of the rotation counts faster.
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

/// Successes of each method from each offset.
struct Basin {
  std::vector<core::RegistrationMethodInfo> methods;
  std::vector<std::vector<std::size_t>> counts;  ///< [method][offset of all_offsets()]
  std::size_t pairs = 0;

  [[nodiscard]] double share(std::size_t method, std::size_t translation, std::size_t rotation) const {
    return static_cast<double>(counts[method][translation * kRotationsDeg.size() + rotation]) /
           static_cast<double>(pairs);
  }
};

Table basin_table(const Basin& basin) {
  Table table{{"registration"}, {}};
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

/// All offsets: a row for each method and rotation, a column for each translation.
Table offset_table(const Basin& basin) {
  Table table{{"registration, rotation"}, {}};
  for (const double translation : kTranslationsMetres) table.headings.push_back(fixed(translation, 1) + " m");
  for (std::size_t m = 0; m < basin.methods.size(); ++m) {
    for (std::size_t r = 0; r < kRotationsDeg.size(); ++r) {
      std::vector<std::string> row{std::string(basin.methods[m].name) + ", " + fixed(kRotationsDeg[r], 1) +
                                   " deg"};
      for (std::size_t t = 0; t < kTranslationsMetres.size(); ++t)
        row.push_back(fixed(basin.share(m, t, r), 2));
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

/// Success over the translation without rotation, and over the rotation without translation.
plot::Figure basin_figure(const Basin& basin) {
  plot::Panel translation;
  translation.x.label = "initial translation error [m]";
  plot::Panel rotation;
  rotation.x.label = "initial rotation error [deg]";
  for (plot::Panel* const panel : {&translation, &rotation}) {
    panel->y = {"share of successes", false, true};
    panel->markers = true;
  }
  for (std::size_t m = 0; m < basin.methods.size(); ++m) {
    plot::Curve over_translation{basin.methods[m].name, {}};
    for (std::size_t t = 0; t < kTranslationsMetres.size(); ++t)
      over_translation.points.emplace_back(kTranslationsMetres[t], basin.share(m, t, 0));
    plot::Curve over_rotation{basin.methods[m].name, {}};
    for (std::size_t r = 0; r < kRotationsDeg.size(); ++r)
      over_rotation.points.emplace_back(kRotationsDeg[r], basin.share(m, 0, r));
    translation.curves.push_back(std::move(over_translation));
    rotation.curves.push_back(std::move(over_rotation));
  }
  return {{std::move(translation), std::move(rotation)}};
}

Result<std::monostate> report(const std::string& name, const Basin& basin, ResultsPage& page) {
  const std::string pairs = ", " + std::to_string(basin.pairs) + " scan pairs for each offset";
  page.table(name + pairs, basin_table(basin));
  page.table(name + ", all offsets", offset_table(basin));
  return page.figure("basin-" + name, "Share of registrations that converge, " + name + pairs,
                     basin_figure(basin), kPictureWidth, kPictureHeight);
}

Result<Basin> measure_basin(const BenchDataset& dataset, std::size_t pairs, const BasinOptions& options) {
  std::fprintf(stderr, "%s: %zu scan pairs\n", dataset.name.c_str(), pairs);
  const Result<daemon::Config> config = bench_config(dataset, options.overrides);
  if (!config) return config.error();
  const auto collected = collect_pairs(dataset, *config, pairs);
  if (!collected) return collected.error();
  Basin basin{chosen_methods(options.registrations), {}, collected->size()};
  basin.counts = count_successes(basin.methods, *collected, all_offsets(), daemon::odometry_config(*config),
                                 options.seed);
  return basin;
}

void add(const Basin& basin, Basin& sum) {
  sum.pairs += basin.pairs;
  if (sum.counts.empty()) {
    sum.methods = basin.methods;
    sum.counts = basin.counts;
    return;
  }
  for (std::size_t m = 0; m < sum.counts.size(); ++m) {
    for (std::size_t k = 0; k < sum.counts[m].size(); ++k) sum.counts[m][k] += basin.counts[m][k];
  }
}

}  // namespace

Result<bool> run_basin_bench(const BasinOptions& options) {
  std::vector<BenchDataset> datasets;
  for (const std::string& argument : options.datasets) {
    Result<BenchDataset> dataset = open_bench_dataset(argument);
    if (!dataset) return dataset.error();
    datasets.push_back(std::move(dataset).value());
  }
  Result<ResultsPage> page = ResultsPage::create(options.page, "Convergence basin");
  if (!page) return page.error();
  page->paragraph(kLegend);
  Basin sum;
  for (std::size_t i = 0; i < datasets.size(); ++i) {
    const std::size_t left = datasets.size() - i;
    const std::size_t share = (options.pairs - sum.pairs + left - 1) / left;
    const Result<Basin> basin = measure_basin(datasets[i], share, options);
    if (!basin) return basin.error();
    if (const auto reported = report(datasets[i].name, *basin, *page); !reported) return reported.error();
    add(*basin, sum);
  }
  if (datasets.size() > 1) {
    if (const auto reported = report("all", sum, *page); !reported) return reported.error();
  }
  if (const auto saved = page->save(); !saved) return saved.error();
  return true;
}

}  // namespace nilio::tools::bench
