#pragma once

#include "daemon/input/replay_files.hpp"
#include "daemon/odometry/pipeline.hpp"

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// Pipeline that has processed a recording completely, with its output.
struct ReplayRun {
  std::unique_ptr<daemon::Pipeline> pipeline;
  std::vector<std::string> notes;  ///< notes of the input
  std::vector<ipc::PoseRecord> poses;
  std::vector<daemon::EventLog::Line> lines;
  std::vector<daemon::ScanDecision> decisions;
  std::uint64_t clouds = 0;
};

inline ReplayRun run_input(const daemon::Config& config, daemon::Input input,
                           const daemon::PipelineOptions& options) {
  ReplayRun run;
  run.notes = input.notes;
  auto pipeline = daemon::Pipeline::create(config, std::move(input), options, nullptr);
  REQUIRE(pipeline.ok());
  run.pipeline = std::move(pipeline).value();
  REQUIRE(run.pipeline->start().ok());
  const auto drain = [&run] {
    while (const auto record = run.pipeline->poses().try_pop()) run.poses.push_back(*record);
    while (run.pipeline->clouds().try_pop()) ++run.clouds;
    while (auto line = run.pipeline->event_log().take()) run.lines.push_back(std::move(*line));
    while (const auto decision = run.pipeline->decisions().try_pop()) run.decisions.push_back(*decision);
  };
  while (!run.pipeline->finished()) {
    run.pipeline->output_event().wait(core::Duration::from_milliseconds(20.0));
    drain();
  }
  run.pipeline->join();
  drain();
  return run;
}

inline ReplayRun run_replay(const std::string& path, const daemon::Config& config = {}) {
  const auto files = daemon::find_replay_files({path});
  REQUIRE(files.ok());
  auto input = daemon::open_replay(*files, config);
  if (!input) FAIL(input.error().message);
  daemon::PipelineOptions options;
  options.collect_clouds = true;
  return run_input(config, std::move(input).value(), options);
}

inline std::uint64_t scans_with_imu(const ReplayRun& run) {
  return run.pipeline->counters().scans_with_imu.load();
}

}  // namespace nilio::tests
