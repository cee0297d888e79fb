#include "tools/bench/matrix/result.hpp"
#include "tools/common/files.hpp"

#include <nlohmann/json.hpp>

namespace nilio::tools::bench {

namespace {

using Json = nlohmann::ordered_json;

Json json_of(const RunFigures& f) {
  if (!f.failure.empty()) return {{"failure", f.failure}};
  return {{"path_m", f.path_m},
          {"drift_percent", f.drift_percent},
          {"end_error_m", f.end_error_m},
          {"rpe_m", f.rpe_m},
          {"nees", f.nees},
          {"nees_count", f.nees_count},
          {"drift_nees", f.drift_nees},
          {"silent_error_s", f.silent_error_s},
          {"recovery_s", f.recovery_s},
          {"cpu_ms", f.cpu_ms},
          {"poses", f.poses},
          {"tracking", f.tracking},
          {"degraded", f.degraded},
          {"lost", f.lost},
          {"ends_tracking", f.ends_tracking}};
}

RunFigures figures_of(const Json& json) {
  RunFigures f;
  if (json.contains("failure")) {
    f.failure = json.at("failure");
    return f;
  }
  f.path_m = json.at("path_m");
  f.drift_percent = json.at("drift_percent");
  f.end_error_m = json.at("end_error_m");
  f.rpe_m = json.at("rpe_m");
  f.nees = json.at("nees");
  f.nees_count = json.at("nees_count");
  // Not in results of earlier versions, and null where there is none.
  if (const auto nees = json.find("drift_nees"); nees != json.end() && nees->is_number())
    f.drift_nees = *nees;
  f.silent_error_s = json.at("silent_error_s");
  f.recovery_s = json.at("recovery_s");
  f.cpu_ms = json.at("cpu_ms");
  f.poses = json.at("poses");
  f.tracking = json.at("tracking");
  f.degraded = json.at("degraded");
  f.lost = json.at("lost");
  f.ends_tracking = json.at("ends_tracking");
  return f;
}

Json json_of(const MatrixRun& run) {
  Json json{{"row", run.row},
            {"run", run.number},
            {"seed", run.seed},
            {"drive_sha256", run.drive_sha256},
            {"bound_percent", run.bound_percent},
            {"success", run.success()},
            {"nilio", json_of(run.figures)}};
  for (const auto& [name, figures] : run.peers) json["peers"][name] = json_of(figures);
  return json;
}

MatrixRun run_of(const Json& json) {
  MatrixRun run;
  run.row = json.at("row");
  run.number = json.at("run");
  run.seed = json.at("seed");
  run.drive_sha256 = json.at("drive_sha256");
  run.bound_percent = json.at("bound_percent");
  run.figures = figures_of(json.at("nilio"));
  if (json.contains("peers")) {
    for (const auto& [name, figures] : json.at("peers").items()) run.peers[name] = figures_of(figures);
  }
  return run;
}

}  // namespace

std::string to_json(const MatrixResult& result) {
  Json json{{"version", result.version},
            {"commit", result.commit},
            {"command", result.command},
            {"complete", result.complete},
            {"skipped", result.skipped}};
  json["runs"] = Json::array();
  // One line a run, so that two files can be compared by eye.
  std::string text = json.dump(2);
  std::string runs;
  for (const MatrixRun& run : result.runs)
    runs += (runs.empty() ? "\n    " : ",\n    ") + json_of(run).dump();
  const std::string empty = "\"runs\": []";
  text.replace(text.find(empty), empty.size(), "\"runs\": [" + runs + "\n  ]");
  return text + "\n";
}

core::Result<MatrixResult> read_matrix_result(const std::string& path) {
  const auto text = file_text(path);
  if (!text) return core::Error{path + ": cannot be read"};
  try {
    const Json json = Json::parse(*text);
    MatrixResult result;
    result.version = json.at("version");
    result.commit = json.at("commit");
    result.command = json.at("command");
    result.complete = json.at("complete");
    // Results of older versions do not tell.
    result.skipped = json.value("skipped", result.skipped);
    for (const Json& run : json.at("runs")) result.runs.push_back(run_of(run));
    return result;
  } catch (const Json::exception& error) {
    return core::Error{path + ": is no result of nilio bench matrix (" + error.what() + ")"};
  }
}

}  // namespace nilio::tools::bench
