#include "tools/bench/odometry/ablation.hpp"

#include "tools/bench/odometry/measure.hpp"

#include <array>

namespace nilio::tools {

namespace {

using core::Result;

struct Choice {
  const char* meaning;
  const char* setting;  ///< of niliod's configuration
};

constexpr std::array<Choice, 15> kChoices = {{
    {"no ICP: NDT alone", "odometry.registration=ndt"},
    {"no NDT: ICP alone", "odometry.registration=icp_plane"},
    {"lines in place of planes", "odometry.registration=icp_line"},
    {"points in place of planes", "odometry.registration=icp_point"},
    {"NDT before every ICP", "odometry.coarse=always"},
    {"no second pass with the motion found", "odometry.max_passes=1"},
    {"500 points", "odometry.registration_points=500"},
    {"8000 points", "odometry.registration_points=8000"},
    {"3 ICP iterations a pass", "odometry.max_fine_iterations=3"},
    {"map fed with half as dense points", "odometry.filter_voxel_m=1.0"},
    {"planes in voxels of 1 m", "odometry.plane_voxel_m=1.0"},
    {"planes in voxels of 2 m", "odometry.plane_voxel_m=2.0"},
    {"map of 50 m", "odometry.map_radius_m=50"},
    {"no IMU", "imu.enabled=false"},
    {"beams as the data set has them", "lidar.elevation_correction_deg=0"},
}};

std::vector<std::string> make_row(const std::string& meaning, const std::string& setting,
                                  const Measurement& m) {
  const auto translation = [](const std::optional<SegmentError>& segment) {
    return segment ? fixed(segment->translation_percent, 3) : std::string("-");
  };
  const Accuracy& a = m.accuracy;
  return {meaning,
          setting,
          translation(a.near),
          translation(a.far),
          a.near ? fixed(a.near->rotation_deg_per_100m, 3) : "-",
          fixed(100.0 * a.rpe_m, 2),
          fixed(a.rpe_deg, 3),
          std::to_string(m.work.predicted),
          fixed(m.cpu.total.median, 2)};
}

}  // namespace

Result<BenchTable> ablation_table(const BenchDataset& dataset, const std::vector<std::string>& overrides) {
  BenchTable table{{"choice", "setting", "t %, 10-80 m", "t %, 100-800 m", "r deg/100 m", "RPE cm", "RPE deg",
                    "not accepted", "CPU ms"},
                   {}};
  const Result<Measurement> reference = measure_odometry(dataset, "default", overrides, 1);
  if (!reference) return reference.error();
  table.rows.push_back(make_row("default", "", *reference));
  for (const Choice& choice : kChoices) {
    std::vector<std::string> changed = overrides;
    changed.emplace_back(choice.setting);
    const Result<Measurement> run = measure_odometry(dataset, choice.meaning, changed, 1);
    if (!run) return run.error();
    if (run->sha256 != reference->sha256)
      table.rows.push_back(make_row(choice.meaning, choice.setting, *run));
  }
  return table;
}

}  // namespace nilio::tools
