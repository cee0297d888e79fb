#pragma once

#include "tools/bench/odometry/measure.hpp"
#include "tools/bench/report/results_page.hpp"

#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

// Tables of runs on one data set. Where the number of threads does not matter, each method has one row.

/// Errors of each method.
Table accuracy_table(std::span<const Measurement> measurements);
/// NEES of each method; methods whose truth has no poses within a sweep are left out.
Table consistency_table(std::span<const Measurement> measurements);
/// Time, memory and allocations of each run.
Table cost_table(std::span<const Measurement> measurements);
/// Times of each stage.
Table stage_table(std::span<const Measurement> measurements);
/// Points, correspondences and iterations of the registration.
Table work_table(std::span<const Measurement> measurements);
/// SHA-256 of each trajectory.
Table hash_table(std::span<const Measurement> measurements);
/// CPU time of PCL as a multiple of the run `own`: of the whole scan, and of its registration alone, because
/// PCL gets the scans filtered and deskewed.
Table pcl_table(const Measurement& own, std::span<const Measurement> pcl);

/// A run of the ablation, with one setting changed.
struct AblationRow {
  std::string change;
  std::string setting;
  Measurement measurement;
};
Table ablation_table(std::span<const AblationRow> rows);

/// Runs the data set under `overrides`, and again with one setting changed at a time. Settings that make no
/// difference, such as the IMU where there is none, are left out.
core::Result<Table> measure_ablation(const BenchDataset& dataset, const std::vector<std::string>& overrides);

/// Left panel: median time of each stage. Right panel: percentiles of the time of a scan. One curve for each
/// method, at most as many as a panel takes.
plot::Figure latency_figure(std::span<const Measurement> measurements);

}  // namespace nilio::tools::bench
