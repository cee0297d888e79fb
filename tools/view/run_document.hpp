#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <string>

#include <nlohmann/json.hpp>

namespace nilio::tools::view {

struct RunDocumentOptions {
  std::string truth_path;  ///< TUM or KITTI; empty: none
  /// More map points are thinned evenly, and more poses to every n-th; the document says so.
  std::size_t max_map_points = 1'000'000;
  std::size_t max_poses = 20'000;
};

/// A finished run as the page reads it.
struct RunDocument {
  nlohmann::json json;  ///< poses, scans, latency, result, configuration, errors
  std::string map;      ///< frames of tiles, one behind the other
};

/// Reads an output folder of niliod: trajectory.tum, and what there is of scans.csv, map.ply, latency.json,
/// result.json and config.yaml. With a truth, the evaluation is that of `nilio evaluate`. Fails without a
/// readable trajectory, and when truth and trajectory do not fit together; other missing or damaged files are
/// listed in "notes".
core::Result<RunDocument> read_run_document(const std::string& folder, const RunDocumentOptions& options);

}  // namespace nilio::tools::view
