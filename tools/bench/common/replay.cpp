#include "tools/bench/common/replay.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "daemon/output/run_output.hpp"
#include "tools/common/system.hpp"

#include <utility>

namespace nilio::tools::bench {

using core::Result;

Result<daemon::Config> recording_config(const daemon::ReplayFiles& files,
                                        const std::vector<std::string>& overrides) {
  daemon::Config config;
  daemon::apply_recording_defaults(files, config);
  if (!files.configuration.empty()) {
    const auto applied = daemon::apply_file(config, files.configuration);
    if (!applied) return applied.error();
  }
  const auto applied = daemon::apply_overrides(config, overrides);
  if (!applied) return applied.error();
  return config;
}

Result<Replay> replay(const daemon::ReplayFiles& files, const daemon::Config& config,
                      core::Odometry::ClockFunction clock, const daemon::ScanObserver& observer,
                      const std::atomic<bool>* stop) {
  Result<daemon::Input> input = daemon::open_replay(files, config);
  if (!input) return input.error();
  Replay run;
  run.T_camera_lidar = input->T_camera_lidar;
  run.T_base_lidar = daemon::to_transform(config.lidar.extrinsic);
  daemon::PipelineOptions options;
  options.clock = clock;
  options.observer = [&](const core::Scan& scan, const core::OdometryResult& result,
                         const core::Odometry& odometry) {
    run.tum += daemon::tum_line(daemon::make_pose_record(result, scan));
    run.results.push_back(result);
    if (observer) observer(scan, result, odometry);
  };
  auto pipeline = daemon::Pipeline::create(config, std::move(input).value(), options, nullptr);
  if (!pipeline) return pipeline.error();
  const auto started = (*pipeline)->start();
  if (!started) return started.error();
  while (!(*pipeline)->finished()) {
    (*pipeline)->output_event().wait(kPoll);
    while ((*pipeline)->poses().try_pop()) {
    }
    if (stop != nullptr && stop->load()) (*pipeline)->request_stop();
  }
  (*pipeline)->join();
  run.scans_with_imu = (*pipeline)->counters().scans_with_imu.load();
  return run;
}

}  // namespace nilio::tools::bench
