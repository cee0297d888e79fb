#include "tools/evaluate/metrics.hpp"

#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"

#include <cmath>
#include <random>

#include <nlohmann/json.hpp>

using nilio::core::Duration;
using nilio::core::Time;
using nilio::tests::run_command;
using nilio::tests::TemporaryFolder;
using namespace nilio::tools;
using namespace nilio::tools::evaluate;

namespace {

Pose make_pose(double x, double y, double z, double yaw_rad = 0.0) {
  Pose pose = Pose::Identity();
  pose.linear() = Eigen::AngleAxisd(yaw_rad, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  pose.translation() << x, y, z;
  return pose;
}

/// One metre per pose, in a gentle S so that alignments are well determined.
std::vector<Pose> make_path(std::size_t count) {
  std::vector<Pose> poses{Pose::Identity()};
  while (poses.size() < count) {
    const double turn = 0.02 * std::cos(0.05 * static_cast<double>(poses.size()));
    poses.push_back(poses.back() * make_pose(1.0, 0.0, 0.01, turn));
  }
  return poses;
}

PosePairs make_pairs(const std::vector<Pose>& truth, const std::vector<Pose>& estimate) {
  PosePairs pairs;
  pairs.truth = truth;
  pairs.estimate = estimate;
  return pairs;
}

Trajectory make_tum(const std::vector<Pose>& poses, std::int64_t first_ns, std::int64_t step_ns) {
  Trajectory trajectory;
  trajectory.path = "t.tum";
  trajectory.poses = poses;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    trajectory.stamps.push_back(Time{first_ns + static_cast<std::int64_t>(i) * step_ns});
  }
  return trajectory;
}

/// The truth with a small random error in every step, as an odometry makes it.
Trajectory with_drift(const Trajectory& truth, double translation_m, double rotation_rad) {
  std::mt19937 generator(7);
  std::normal_distribution<double> normal;
  const auto random_vector = [&](double scale) -> Eigen::Vector3d {
    return scale * Eigen::Vector3d(normal(generator), normal(generator), normal(generator));
  };
  Trajectory estimate = truth;
  for (std::size_t i = 1; i < truth.poses.size(); ++i) {
    const Eigen::Vector3d turn = random_vector(rotation_rad);
    Pose noise = Pose::Identity();
    noise.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()).toRotationMatrix();
    noise.translation() = random_vector(translation_m);
    estimate.poses[i] = estimate.poses[i - 1] * (truth.poses[i - 1].inverse() * truth.poses[i]) * noise;
  }
  return estimate;
}

}  // namespace

TEST_CASE("statistics follow evo's definitions", "[metrics]") {
  const Statistics s = compute_statistics({4.0, 1.0, 3.0, 2.0});
  CHECK(s.rmse == Approx(std::sqrt(7.5)));
  CHECK(s.mean == Approx(2.5));
  CHECK(s.median == Approx(2.5));
  CHECK(s.std == Approx(std::sqrt(1.25)));
  CHECK(s.min == 1.0);
  CHECK(s.max == 4.0);
  CHECK(compute_statistics({}).max == 0.0);
}

TEST_CASE("a trajectory equals itself in every metric", "[metrics]") {
  const std::vector<Pose> path = make_path(1000);
  const Evaluation e = nilio::tools::evaluate::evaluate(make_pairs(path, path), {});
  CHECK(e.truth_length_m == e.estimate_length_m);
  for (const AbsoluteError& error : e.absolute) {
    CHECK(error.errors.translation_m.max < 1e-9);
    CHECK(error.errors.rotation_deg.max < 1e-6);
  }
  CHECK(e.relative.translation_m.max < 1e-9);
  REQUIRE(e.segments);
  CHECK(e.segments->all.translation_percent < 1e-9);
  CHECK(e.segments->per_length.size() == 8);
}

TEST_CASE("a rigid motion of the whole estimate causes no error after alignment", "[metrics]") {
  const std::vector<Pose> path = make_path(300);
  const Pose motion = make_pose(10.0, -20.0, 30.0, 1.0);
  std::vector<Pose> moved;
  moved.reserve(path.size());
  for (const Pose& pose : path) moved.push_back(motion * pose);
  EvaluationOptions options;
  options.report_unaligned = true;
  const Evaluation e = nilio::tools::evaluate::evaluate(make_pairs(path, moved), options);
  REQUIRE(e.absolute.size() == 3);
  CHECK(e.absolute[0].alignment == Alignment::kNone);
  CHECK(e.absolute[0].errors.translation_m.min > 10.0);
  CHECK(e.absolute[0].errors.rotation_deg.mean == Approx(180.0 / M_PI));
  CHECK(e.absolute[1].errors.translation_m.max < 1e-9);
  CHECK(e.absolute[2].errors.translation_m.max < 1e-9);
  CHECK(e.relative.rotation_deg.max < 1e-6);
  CHECK_FALSE(e.alignment_degenerate);
}

TEST_CASE("a scale error of one percent is one percent of every segment and of the path", "[metrics]") {
  const std::vector<Pose> path = make_path(1000);
  std::vector<Pose> scaled = path;
  for (Pose& pose : scaled) pose.translation() *= 1.01;
  const Evaluation e = nilio::tools::evaluate::evaluate(make_pairs(path, scaled), {});
  CHECK(e.estimate_length_m / e.truth_length_m == Approx(1.01));
  CHECK(e.relative.translation_m.rmse ==
        Approx(0.01 * (path[1].translation() - path[0].translation()).norm()));
  REQUIRE(e.short_segments);
  // The S makes chords a little shorter than the path; a segment ends at the first pose beyond its length.
  CHECK(e.short_segments->all.translation_percent == Approx(1.0).margin(0.06));
  const AbsoluteError& origin = e.absolute[0];
  CHECK(origin.end_translation_m == Approx(0.01 * path.back().translation().norm()));
}

TEST_CASE("a constant turn error per metre is found in the segments' rotation", "[metrics]") {
  std::vector<Pose> truth{Pose::Identity()};
  std::vector<Pose> estimate{Pose::Identity()};
  const double error_rad = 1e-4;
  for (int i = 0; i < 900; ++i) {
    truth.push_back(truth.back() * make_pose(1.0, 0.0, 0.0));
    estimate.push_back(estimate.back() * make_pose(1.0, 0.0, 0.0, error_rad));
  }
  const Evaluation e = nilio::tools::evaluate::evaluate(make_pairs(truth, estimate), {});
  REQUIRE(e.segments);
  for (const SegmentError& segment : e.segments->per_length) {
    // The devkit's last pose is the first one beyond the length, here one metre.
    const double turned_rad = error_rad * (segment.length_m + 1.0);
    CHECK(segment.rotation_deg_per_100m == Approx(turned_rad * 180.0 / M_PI / segment.length_m * 100.0));
  }
  CHECK(e.relative.rotation_deg.mean == Approx(error_rad * 180.0 / M_PI));
  CHECK(e.alignment_degenerate);
}

TEST_CASE("segments begin at every tenth pose and only where the path is long enough", "[metrics]") {
  std::vector<Pose> path;
  for (int i = 0; i <= 120; ++i) path.push_back(make_pose(i, 0.0, 0.0));
  const std::array<double, 2> lengths{100.0, 200.0};
  const auto errors = segment_errors(make_pairs(path, path), lengths, 10);
  REQUIRE(errors);
  // From 0 and 10 m the path has more than 100 m left; at 20 m exactly 100 m, which is not enough.
  CHECK(errors->all.count == 2);
  CHECK(errors->per_length.size() == 1);
  CHECK_FALSE(segment_errors(make_pairs(path, path), std::array<double, 1>{120.0}, 10));
}

TEST_CASE("the truth is interpolated at the estimate's stamps, and unmatched poses are counted",
          "[metrics]") {
  const std::vector<Pose> path = make_path(50);
  const Trajectory truth = make_tum(path, 0, 100'000'000);
  std::vector<Pose> halfway;
  for (std::size_t i = 1; i < path.size(); ++i) {
    Pose pose = path[i];
    pose.translation() = 0.5 * (path[i - 1].translation() + path[i].translation());
    halfway.push_back(pose);
  }
  const Trajectory estimate = make_tum(halfway, 1'050'000'000, 100'000'000);
  const auto pairs = associate(truth, estimate, {});
  REQUIRE(pairs);
  CHECK(pairs->truth.size() == 39);
  CHECK(pairs->unmatched_estimate == 10);
  CHECK(pairs->unmatched_truth == 11);
  CHECK((pairs->truth[0].translation() - 0.5 * (path[10].translation() + path[11].translation())).norm() <
        1e-12);
}

TEST_CASE("nearest association takes only poses within the limit", "[metrics]") {
  const std::vector<Pose> path = make_path(20);
  const Trajectory truth = make_tum(path, 0, 100'000'000);
  const Trajectory estimate = make_tum({path[3], path[4], path[5]}, 308'000'000, 103'000'000);
  AssociationOptions options;
  options.method = Association::kNearest;
  // Differences are 8, 11 and 14 ms: one pose is too few.
  CHECK_FALSE(associate(truth, estimate, options));
  options.max_time_difference = Duration{12'000'000};
  const auto pairs = associate(truth, estimate, options);
  REQUIRE(pairs);
  CHECK(pairs->truth.size() == 2);
  CHECK(pairs->unmatched_estimate == 1);
  CHECK(pairs->unmatched_truth == 18);
  CHECK(pairs->truth[1].matrix() == path[4].matrix());
}

TEST_CASE("trajectories without common time are refused with both time ranges", "[metrics]") {
  const Trajectory truth = make_tum(make_path(11), 1'000'000'000'000, 100'000'000);
  const Trajectory estimate = make_tum(make_path(11), 0, 100'000'000);
  const auto pairs = associate(truth, estimate, {});
  REQUIRE_FALSE(pairs);
  CHECK(pairs.error().message.find("1000.000 .. 1001.000 s") != std::string::npos);
  CHECK(pairs.error().message.find("0.000 .. 1.000 s") != std::string::npos);
  Trajectory kitti = truth;
  kitti.format = TrajectoryFormat::kKitti;
  CHECK(associate(kitti, estimate, {}).error().message.find("same format") != std::string::npos);
}

TEST_CASE("the exit status of evaluate distinguishes bad input from exceeded thresholds", "[metrics]") {
  const TemporaryFolder folder;
  Trajectory truth = make_tum(make_path(400), 0, 100'000'000);
  REQUIRE(write_trajectory(truth, folder.file("truth.tum")));
  for (Pose& pose : truth.poses) pose.translation() *= 1.02;
  REQUIRE(write_trajectory(truth, folder.file("estimate.tum")));
  const auto run = [&](std::vector<std::string> more) {
    std::vector<std::string> arguments{"evaluate", folder.file("truth.tum"), folder.file("estimate.tum"),
                                       "--json", folder.file("result.json")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return run_command(add_evaluate_command, arguments);
  };
  CHECK(run({}) == 0);
  CHECK(run({"--max-drift", "3", "--max-t", "3"}) == 0);
  CHECK(run({"--max-drift", "1"}) == 3);
  CHECK(run({"--max-t", "1"}) == 3);
  CHECK(run({"--max-t", "1", "--segments", "5000"}) == 1);
  CHECK(run({"--calib", folder.file("missing")}) == 1);
  CHECK(run({"--align", "sim3"}) == -1);
  CHECK(run_command(add_evaluate_command, {"evaluate", folder.file("missing"), folder.file("truth.tum")}) ==
        1);
  CHECK(run({"--align", "se3", "--segments", "50,60"}) == 0);
  const auto json = nlohmann::json::parse(nilio::tests::read_file(folder.file("result.json")));
  CHECK(json["end_drift"]["alignment"] == "se3");
  CHECK(json["segments"]["per_length"].size() == 2);
  CHECK(json["path"]["ratio"].get<double>() == Approx(1.02));
}

TEST_CASE("all numbers agree with the reference script on real poses with synthetic drift", "[metrics]") {
  NILIO_REQUIRE_DATA(script, "../tools/eval_traj.py");
  NILIO_REQUIRE_DATA(archive, "kitti/odometry_poses_00-10.tar.xz");
  if (!nilio::tests::run_program("/usr/bin/python3 -c 'import numpy' 2>&1").second) {
    WARN("skipped: python3 has no numpy");
    return;
  }
  const TemporaryFolder folder;
  REQUIRE(
      nilio::tests::run_program("tar -xJf '" + archive.string() + "' -C '" + folder.file("") + "'").second);
  for (const std::string sequence : {"01", "04", "07", "10"}) {
    CAPTURE(sequence);
    const auto truth = read_trajectory(folder.file(sequence + ".txt"));
    REQUIRE(truth);
    REQUIRE(write_trajectory(with_drift(*truth, 0.02, 0.0005), folder.file("estimate.txt")));
    REQUIRE(run_command(add_evaluate_command,
                        {"evaluate", folder.file(sequence + ".txt"), folder.file("estimate.txt"), "--json",
                         folder.file("result.json")}) == 0);
    const auto ours = nlohmann::json::parse(nilio::tests::read_file(folder.file("result.json")));
    const auto [text, succeeded] = nilio::tests::run_program(
        "/usr/bin/python3 '" + script.string() + "' --json --gt '" + folder.file(sequence + ".txt") +
        "' --est '" + folder.file("estimate.txt") + "'");
    REQUIRE(succeeded);
    const auto reference = nlohmann::json::parse(text);
    const auto same = [](const nlohmann::json& a, const nlohmann::json& b, double factor = 1.0) {
      CHECK(factor * a.get<double>() == Approx(b.get<double>()).epsilon(1e-5));
    };
    same(ours["path"]["truth_m"], reference["length_m"]);
    for (const auto& [our_key, key] :
         {std::pair("segments", "kitti"), std::pair("short_segments", "short")}) {
      same(ours[our_key]["translation_percent"], reference[key]["t_pct"]);
      same(ours[our_key]["rotation_deg_per_100m"], reference[key]["r_deg100m"]);
      CHECK(ours[our_key]["segments"] == reference[key]["nseg"]);
    }
    same(ours["rpe"]["translation_m"]["rmse"], reference["rpe"]["t_rmse_cm"], 100.0);
    same(ours["rpe"]["translation_m"]["mean"], reference["rpe"]["t_mean_cm"], 100.0);
    same(ours["rpe"]["rotation_deg"]["rmse"], reference["rpe"]["r_rmse_deg"]);
    same(ours["ape"]["se3"]["translation_m"]["rmse"], reference["ape"]["rmse"]);
    same(ours["ape"]["se3"]["translation_m"]["max"], reference["ape"]["max"]);
    same(ours["end_drift"]["translation_m"], reference["end"]["m"]);
    same(ours["end_drift"]["rotation_deg"], reference["end"]["rot_deg"]);
  }
}
