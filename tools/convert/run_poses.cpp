#include "tools/convert/run_poses.hpp"

#include "nilio/drivers/bag/mcap_writer.hpp"
#include "nilio/drivers/bag/sources.hpp"

#include "daemon/output/run_mcap.hpp"
#include "daemon/output/run_messages.hpp"
#include "tools/common/files.hpp"

#include <cstring>
#include <fstream>
#include <iostream>
#include <utility>
#include <vector>

namespace nilio::tools::convert {

namespace {

using core::Error;
using core::Result;

Pose isometry(const core::SE3& pose) {
  Pose result = Pose::Identity();
  result.linear() = pose.rotation.toRotationMatrix();
  result.translation() = pose.translation;
  return result;
}

/// The topic that is meant: the named one, or the only one with poses in the first chunk of the bag.
Result<std::string> choose_topic(const std::vector<std::string>& files, const std::string& bag,
                                 const std::string& named) {
  const auto survey = drivers::survey_bag(files);
  if (!survey) return survey.error();
  const auto topics = survey->with(drivers::BagContent::kPose);
  std::string list;
  for (const drivers::BagTopicSurvey* const topic : topics) {
    if (topic->topic.name == named || (named.empty() && topics.size() == 1)) {
      const std::string problem = drivers::why_undecodable(topic->topic);
      if (!problem.empty()) return Error{bag + ": " + problem};
      return topic->topic.name;
    }
    list += (list.empty() ? "" : ", ") + topic->topic.name + " (" + topic->topic.type + ")";
  }
  if (list.empty())
    return Error{
        bag + ": no topic with poses (Odometry, PoseStamped, PoseWithCovarianceStamped, TransformStamped)"};
  if (named.empty()) return Error{bag + ": several topics have poses - set --topic to one of " + list};
  return Error{bag + ": --topic: '" + named + "' has no poses in the recording; those that do: " + list};
}

daemon::StampedPose stamped_pose(const Trajectory& trajectory, std::size_t i) {
  const core::SE3 pose = se3_of(trajectory.poses[i]);
  const Eigen::Vector3d& t = pose.translation;
  return {trajectory.stamps[i].ns, {t.x(), t.y(), t.z()}, core::xyzw(pose.rotation)};
}

}  // namespace

Result<Trajectory> read_bag_poses(const std::string& bag, const std::string& topic) {
  const auto files = drivers::bag_files(bag);
  if (!files) return files.error();
  const auto chosen = choose_topic(*files, bag, topic);
  if (!chosen) return chosen.error();
  const std::string& name = *chosen;
  const auto reader = drivers::open_bag(*files, [&](const drivers::BagTopic& t) { return t.name == name; });
  if (!reader) return reader.error();
  Trajectory trajectory;
  trajectory.path = bag;
  std::uint64_t skipped = 0;
  while (const auto message = (*reader)->next()) {
    const auto pose = drivers::decode_pose((*reader)->topics()[message->topic], *message);
    const bool is_next = pose && (trajectory.stamps.empty() || pose->header.stamp > trajectory.stamps.back());
    if (!is_next) {
      ++skipped;
      continue;
    }
    trajectory.stamps.push_back(pose->header.stamp);
    trajectory.poses.push_back(isometry(pose->pose));
  }
  for (const std::string& note : (*reader)->notes()) std::cerr << "warning: " << note << '\n';
  if (skipped > 0)
    std::cerr << "warning: " << name << ": " << skipped
              << " messages are damaged, or their stamps do not increase; they are left out\n";
  if (trajectory.poses.empty()) return Error{bag + ": " + name + " has no usable pose"};
  return trajectory;
}

ScanColumns read_scan_columns(const std::filesystem::path& folder) {
  ScanColumns columns;
  std::ifstream file(folder / "scans.csv");
  std::string line;
  const auto split = [&](std::string& stamp, std::string& rest) {
    const std::size_t first = line.find(',');
    const std::size_t second = first == std::string::npos ? first : line.find(',', first + 1);
    if (second == std::string::npos) return false;
    stamp = line.substr(first + 1, second - first - 1);
    rest = line.substr(second + 1);
    return true;
  };
  std::string stamp;
  std::string rest;
  if (!std::getline(file, line) || !split(stamp, columns.names)) return columns;
  while (std::getline(file, line)) {
    if (split(stamp, rest)) columns.rows[stamp] = rest;
  }
  return columns;
}

Result<std::monostate> write_mcap(const Trajectory& trajectory, const std::string& path) {
  const UnfinishedFile file(path);
  drivers::McapWriter writer(file.path(), daemon::trajectory_channels());
  const daemon::RunFrames frames;
  std::vector<std::uint8_t> message;
  const auto add = [&](daemon::TrajectoryChannel channel, core::Time stamp) {
    writer.add(static_cast<std::size_t>(channel), stamp, message);
    return writer.file().write_pending();
  };
  std::vector<daemon::StampedPose> poses;
  for (std::size_t i = 0; i < trajectory.poses.size(); ++i) poses.push_back(stamped_pose(trajectory, i));
  std::vector<daemon::StampedPose> path_poses;
  const std::size_t step =
      (poses.size() + daemon::RunMcap::kMaxPathPoses - 1) / daemon::RunMcap::kMaxPathPoses;
  for (std::size_t i = 0; i < poses.size(); i += step) path_poses.push_back(poses[i]);
  daemon::write_path(path_poses, frames, message);
  int error = add(daemon::TrajectoryChannel::kPath, trajectory.stamps.front());
  for (std::size_t i = 0; i < poses.size() && error == 0; ++i) {
    daemon::write_pose(poses[i], frames, message);
    error = add(daemon::TrajectoryChannel::kPose, trajectory.stamps[i]);
    daemon::write_transform(poses[i], frames, message);
    if (error == 0) error = add(daemon::TrajectoryChannel::kTransform, trajectory.stamps[i]);
  }
  writer.finish();
  if (error == 0) error = writer.file().write_pending();
  if (error == 0) error = writer.file().close();
  if (error != 0 || writer.lost() > 0)
    return Error{path + ": cannot be written" +
                 (error != 0 ? std::string(" (") + std::strerror(error) + ")" : "") +
                 " - check the folder and the space on the disk"};
  return file.finish();
}

}  // namespace nilio::tools::convert
