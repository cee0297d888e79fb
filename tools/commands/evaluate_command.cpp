#include "daemon/exit_status.hpp"
#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/evaluate/gnss.hpp"
#include "tools/evaluate/metrics.hpp"

#include <cmath>
#include <fstream>
#include <iostream>
#include <memory>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

struct EvaluateArguments {
  std::string truth_path;
  std::string estimate_path;
  std::string calibration_path;
  std::string json_path;
  evaluate::Alignment alignment = evaluate::Alignment::kOrigin;
  evaluate::Association association = evaluate::Association::kInterpolate;
  std::optional<double> max_time_difference_s;
  std::vector<double> segment_lengths_m;
  std::optional<double> max_drift_percent;
  std::optional<double> max_translation_percent;
  std::string topic;
  gnss::GeoreferenceOptions georeference;
  /// Options given that need poses as truth.
  std::string pose_options;
};

/// Converts LiDAR poses to camera poses: T_camera_lidar * T * T_camera_lidar^-1.
core::Result<Trajectory> to_camera_frame(Trajectory trajectory, const std::string& calibration_path) {
  const auto T_camera_lidar = read_kitti_calibration(calibration_path);
  if (!T_camera_lidar) return T_camera_lidar.error();
  for (Pose& pose : trajectory.poses) pose = *T_camera_lidar * pose * T_camera_lidar->inverse();
  return trajectory;
}

core::Result<evaluate::PosePairs> load_pairs(const EvaluateArguments& arguments) {
  const auto truth = read_trajectory(arguments.truth_path);
  if (!truth) return truth.error();
  auto estimate = read_trajectory(arguments.estimate_path);
  if (!estimate) return estimate.error();
  if (!arguments.calibration_path.empty()) {
    estimate = to_camera_frame(std::move(estimate).value(), arguments.calibration_path);
    if (!estimate) return estimate.error();
  }
  evaluate::AssociationOptions options;
  options.method = arguments.association;
  if (arguments.max_time_difference_s) {
    options.max_time_difference = core::Duration::from_seconds(*arguments.max_time_difference_s);
  }
  return evaluate::associate(*truth, *estimate, options);
}

int fail(const std::string& message) {
  std::cerr << "nilio evaluate: " << message << '\n';
  return kFailed;
}

/// 0, or 3 with a line if --max-t is exceeded, or 1 when it cannot be checked. `percent`: empty without
/// segments.
int check_translation(std::optional<double> percent, double path_m, const EvaluateArguments& arguments) {
  if (!arguments.max_translation_percent) return 0;
  if (!percent) {
    std::cerr << "nilio evaluate: --max-t cannot be checked: the path of " << path_m
              << " m has no segment - give shorter ones with --segments\n";
    return kFailed;
  }
  if (*percent <= *arguments.max_translation_percent) return 0;
  std::cerr << "nilio evaluate: t_rel " << *percent << " % exceeds --max-t "
            << *arguments.max_translation_percent << " %\n";
  return kBadResult;
}

/// 0, or 3 with a line for each threshold that is exceeded, or 1 when a threshold cannot be checked.
int check_thresholds(const evaluate::Evaluation& evaluation, const EvaluateArguments& arguments) {
  int status = 0;
  if (arguments.max_drift_percent) {
    if (evaluation.truth_length_m <= 0.0)
      return fail("--max-drift cannot be checked: the truth does not move - leave it out");
    const double drift = evaluate::end_drift_percent(evaluation, arguments.alignment);
    if (!(drift <= *arguments.max_drift_percent)) {
      std::cerr << "nilio evaluate: end drift " << drift << " % exceeds --max-drift "
                << *arguments.max_drift_percent << " %\n";
      status = kBadResult;
    }
  }
  const auto& segments = evaluation.segments;
  const int translation =
      check_translation(segments ? std::optional(segments->all.translation_percent) : std::nullopt,
                        evaluation.truth_length_m, arguments);
  return translation == 0 ? status : translation;
}

bool write_json(const std::string& path, const std::string& json) {
  if (path == "-") {
    std::cout << json;
    return true;
  }
  std::ofstream file(path);
  file << json;
  file.close();
  if (file) return true;
  fail(path + ": cannot be written - check the folder and the space on the disk");
  return false;
}

/// Prints the report or, as chosen, JSON; false if it cannot be written.
bool print(const EvaluateArguments& arguments, const std::string& report, const std::string& json) {
  if (arguments.json_path != "-") std::cout << report;
  return arguments.json_path.empty() || write_json(arguments.json_path, json);
}

int run_gnss(const EvaluateArguments& arguments) {
  if (!arguments.pose_options.empty())
    return fail(arguments.pose_options +
                ": needs poses as truth, and a GNSS track has positions only - leave "
                "it out");
  const auto track = gnss::read_track(arguments.truth_path, arguments.topic);
  if (!track) return fail(track.error().message);
  const auto trajectory = read_trajectory(arguments.estimate_path);
  if (!trajectory) return fail(trajectory.error().message);
  gnss::GeoreferenceOptions options = arguments.georeference;
  if (arguments.max_time_difference_s)
    options.max_gap = core::Duration::from_seconds(*arguments.max_time_difference_s);
  const auto found = gnss::georeference(*trajectory, *track, options);
  if (!found) return fail(found.error().message);
  const evaluate::GnssEvaluation evaluation =
      evaluate::evaluate_gnss(*found, *track, arguments.segment_lengths_m);
  if (!print(arguments, evaluate::gnss_report(evaluation, *found, *track),
             evaluate::gnss_json(evaluation, *found, *track)))
    return kFailed;
  return check_translation(evaluation.all ? std::optional(evaluation.all->percent) : std::nullopt,
                           evaluation.path_m, arguments);
}

int run_evaluate(const EvaluateArguments& arguments) {
  if (gnss::may_hold_track(arguments.truth_path)) return run_gnss(arguments);
  const auto pairs = load_pairs(arguments);
  if (!pairs) return fail(pairs.error().message);
  evaluate::EvaluationOptions options;
  options.report_unaligned = arguments.alignment == evaluate::Alignment::kNone;
  if (!arguments.segment_lengths_m.empty()) options.segment_lengths_m = arguments.segment_lengths_m;
  const evaluate::Evaluation evaluation = evaluate::evaluate(*pairs, options);
  const evaluate::ReportOptions report{arguments.alignment};
  if (!print(arguments, evaluate::format_report(evaluation, report),
             evaluate::format_json(evaluation, report)))
    return kFailed;
  return check_thresholds(evaluation, arguments);
}

}  // namespace

void add_evaluate_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<EvaluateArguments>();
  CLI::App* command =
      app.add_subcommand("evaluate", "compare a trajectory with the truth: APE, RPE, KITTI segments");
  command->footer(
      "Both files are TUM (time x y z qx qy qz qw) or both are KITTI (12 numbers per line, paired line by "
      "line), or the truth is the track of a GNSS receiver: a ROS bag with sensor_msgs/NavSatFix or "
      "nmea_msgs/Sentence, a capture with sentences, or a CSV file of 'nilio convert gnss'. The estimate, a "
      "TUM "
      "file whose z axis is up, is then placed on the earth by heading and position (robust least squares), "
      "and "
      "its horizontal and vertical errors stand beside the accuracy that the receiver states.");
  command->add_option("truth", arguments->truth_path, "true trajectory, or recording with GNSS positions")
      ->required();
  command->add_option("estimate", arguments->estimate_path, "trajectory to compare with it")->required();
  command->add_option(
      "--calib", arguments->calibration_path,
      "KITTI calib.txt: turns an estimate of the LiDAR into the camera's frame with its line Tr:");
  command
      ->add_option("--align", arguments->alignment,
                   "alignment that counts for the end drift; 'none' adds the unaligned APE (default: origin)")
      ->transform(choice_of<evaluate::Alignment>({{"none", evaluate::Alignment::kNone},
                                                  {"origin", evaluate::Alignment::kOrigin},
                                                  {"se3", evaluate::Alignment::kSe3}}));
  command
      ->add_option("--associate", arguments->association,
                   "TUM: 'interpolate' the truth at the estimate's times (default), or 'nearest' as evo does")
      ->transform(choice_of<evaluate::Association>({{"interpolate", evaluate::Association::kInterpolate},
                                                    {"nearest", evaluate::Association::kNearest}}));
  command
      ->add_option(
          "--max-time-difference", arguments->max_time_difference_s,
          "seconds; nearest: between the two poses (default 0.01), interpolate: between the truth's poses "
          "around the estimate's, GNSS: between the estimate's around a position (both default 0.2)")
      ->check(CLI::Range(0.0, 1e6));
  command
      ->add_option("--segments", arguments->segment_lengths_m,
                   "segment lengths in metres instead of 100,200,...,800")
      ->delimiter(',')
      ->check(CLI::Range(1e-3, 1e7));
  command->add_option("--json", arguments->json_path,
                      "also write the numbers as JSON; '-': only JSON, to standard output");
  command
      ->add_option("--max-drift", arguments->max_drift_percent,
                   "exit with status 3 when the end drift is more than this percentage of the path")
      ->check(CLI::NonNegativeNumber);
  command
      ->add_option(
          "--max-t", arguments->max_translation_percent,
          "exit with status 3 when the segments' mean translation error is more than this percentage")
      ->check(CLI::NonNegativeNumber);
  command->add_option("--topic", arguments->topic, "GNSS: topic of a bag with several topics of positions");
  add_georeference_options(*command, arguments->georeference);
  command->callback([arguments, command, &status] {
    for (const char* const option : {"--calib", "--align", "--associate", "--max-drift"}) {
      if (command->count(option) > 0) arguments->pose_options = option;
    }
    status = run_evaluate(*arguments);
  });
}

}  // namespace nilio::tools
