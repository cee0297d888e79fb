#include "daemon/input/bag_input.hpp"

#include "nilio/core/portable_math.hpp"
#include "nilio/core/units.hpp"

#include "daemon/input/cloud_feed.hpp"
#include "daemon/input/imu_input.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <utility>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;
using drivers::BagContent;
using drivers::BagSurvey;
using drivers::BagTopicSurvey;

// Clocks that differ by more are different clocks.
constexpr core::Duration kSameClock = core::Duration::from_seconds(1.0);

template <class... Values>
std::string text(const char* format, Values... values) {
  std::array<char, 400> line{};
  std::snprintf(line.data(), line.size(), format, values...);
  return line.data();
}

/// Names come from the file: nothing in them may control a terminal.
std::string printable(std::string name) {
  name.resize(std::min<std::size_t>(name.size(), 100));
  std::ranges::replace_if(
      name, [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7F; }, '?');
  return name;
}

const BagTopicSurvey* find_topic(const BagSurvey& survey, const std::string& name) {
  const auto found = std::ranges::find_if(
      survey.topics, [&](const BagTopicSurvey& topic) { return topic.topic.name == name; });
  return found == survey.topics.end() ? nullptr : &*found;
}

/// The configured topic, or the only one of these contents, the first content first; null without one.
Result<const BagTopicSurvey*> choose(const BagSurvey& survey, const std::string& configured,
                                     const std::string& key, const std::vector<BagContent>& contents,
                                     const std::string& bag) {
  const auto listed = [&](const std::string& problem) {
    return Error{bag + ": " + problem + "; its topics:\n" + list_topics(survey)};
  };
  if (!configured.empty()) {
    const BagTopicSurvey* const topic = find_topic(survey, configured);
    if (topic == nullptr) return listed(key + ": '" + configured + "' is not in the recording");
    if (std::ranges::find(contents, topic->content) == contents.end())
      return listed(key + ": '" + configured + "' has messages of another kind");
    return topic;
  }
  for (const BagContent content : contents) {
    const std::vector<const BagTopicSurvey*> found = survey.with(content);
    if (found.size() == 1) return found.front();
    if (found.size() > 1)
      return listed(std::to_string(found.size()) + " topics may be meant - set " + key + " to one of them");
  }
  return static_cast<const BagTopicSurvey*>(nullptr);
}

ExtrinsicConfig extrinsic_of(const core::SE3& transform) {
  const Eigen::Matrix3d r = transform.rotation.toRotationMatrix();
  const double pitch = portable::atan2(-r(2, 0), std::sqrt(r(2, 1) * r(2, 1) + r(2, 2) * r(2, 2)));
  const double roll = portable::atan2(r(2, 1), r(2, 2));
  const double yaw = portable::atan2(r(1, 0), r(0, 0));
  ExtrinsicConfig extrinsic;
  extrinsic.translation = {transform.translation.x(), transform.translation.y(), transform.translation.z()};
  extrinsic.rotation_rpy_deg = {roll / kRadiansPerDegree, pitch / kRadiansPerDegree, yaw / kRadiansPerDegree};
  return extrinsic;
}

std::string text_of(const ExtrinsicConfig& extrinsic) {
  const auto& t = extrinsic.translation;
  const auto& r = extrinsic.rotation_rpy_deg;
  return text("translation [%.3f, %.3f, %.3f] m, rotation_rpy_deg [%.2f, %.2f, %.2f]", t[0], t[1], t[2], r[0],
              r[1], r[2]);
}

bool is_configured(const Config& config, const std::string& section) {
  return std::ranges::any_of(config.sources.origin_of, [&](const auto& origin) {
    return origin.first.starts_with(section + ".extrinsic.");
  });
}

/// Extrinsics by /tf_static.
Result<std::monostate> find_extrinsics(const BagSurvey& survey, const BagTopics& topics, const Config& config,
                                       Input& input) {
  const BagTopicSurvey* const lidar = find_topic(survey, topics.lidar);
  const BagTopicSurvey* const imu = find_topic(survey, topics.imu);
  const std::string& base = config.recording.base_frame;
  const auto place = [&](const std::string& section, const BagTopicSurvey& topic,
                         std::optional<ExtrinsicConfig>& extrinsic) -> Result<std::monostate> {
    const auto transform = drivers::find_transform(survey.static_transforms, base, topic.frame_id);
    if (!transform)
      return Error{"recording.base_frame: /tf_static does not connect '" + base + "' with '" +
                   topic.frame_id + "', the frame of " + topic.topic.name + " - correct the frame, or set " +
                   section + ".extrinsic"};
    extrinsic = extrinsic_of(*transform);
    input.notes.push_back(section + ".extrinsic from /tf_static, " + base + " to " + topic.frame_id + ": " +
                          text_of(*extrinsic));
    return std::monostate{};
  };
  const bool by_hand = is_configured(config, "lidar") || is_configured(config, "imu");
  if (!base.empty()) {
    if (auto placed = place("lidar", *lidar, input.lidar_extrinsic); !placed) return placed;
    if (imu == nullptr || topics.imu_content != BagContent::kImu) return std::monostate{};
    return place("imu", *imu, input.imu_extrinsic);
  }
  if (imu == nullptr || topics.imu_content != BagContent::kImu) return std::monostate{};
  const auto T_lidar_imu = drivers::find_transform(survey.static_transforms, lidar->frame_id, imu->frame_id);
  if (by_hand) {
    if (T_lidar_imu) input.notes.emplace_back("extrinsics are those of the configuration, not of /tf_static");
  } else if (T_lidar_imu && lidar->frame_id != imu->frame_id) {
    input.imu_extrinsic = extrinsic_of(*T_lidar_imu);
    input.notes.push_back("imu.extrinsic from /tf_static, the LiDAR's frame is base_link: " +
                          text_of(*input.imu_extrinsic));
  } else if (!T_lidar_imu) {
    input.warnings.push_back("extrinsics: neither configured nor in /tf_static (" + lidar->frame_id + ", " +
                             imu->frame_id + ") - LiDAR and IMU are taken as one; set imu.extrinsic");
  }
  return std::monostate{};
}

/// Correction of the IMU's stamps onto the LiDAR's clock, by their receive times, if the clocks differ.
core::Duration imu_shift(const BagSurvey& survey, const BagTopics& topics, Input& input) {
  const BagTopicSurvey* const lidar = find_topic(survey, topics.lidar);
  const BagTopicSurvey* const imu = find_topic(survey, topics.imu);
  if (lidar == nullptr || imu == nullptr || !lidar->smallest_delay || !imu->smallest_delay) return {};
  const core::Duration shift = *imu->smallest_delay - *lidar->smallest_delay;
  if (shift <= kSameClock && -shift <= kSameClock) return {};
  input.warnings.push_back(text(
      "clocks of %s and %s differ by %.3f s: the IMU's stamps are shifted by their receive times, which is "
      "accurate to some milliseconds - set imu.time_offset_ms for the rest",
      imu->topic.name.c_str(), lidar->topic.name.c_str(), shift.seconds()));
  return shift;
}

Result<std::monostate> open_imu(const std::vector<std::string>& bags, const BagSurvey& survey,
                                const BagTopics& topics, const Config& config, Input& input) {
  if (!config.imu.enabled) {
    input.notes.push_back(std::string("imu.enabled: false; ") + kNoImu);
    return std::monostate{};
  }
  if (topics.imu.empty()) {
    input.warnings.push_back(std::string("no sensor_msgs/Imu and no can_msgs/Frame in the recording; ") +
                             kNoImu);
    return std::monostate{};
  }
  if (topics.imu_content == BagContent::kCanFrame) {
    auto head = drivers::open_bag_frames(bags, topics.imu);
    if (!head) return head.error();
    if (auto found = find_recorded_imu(config.imu, **head, bags.front() + " " + topics.imu, input); !found)
      return found.error();
    auto frames = drivers::open_bag_frames(bags, topics.imu);
    if (!frames) return frames.error();
    input.frames = std::move(frames).value();
    return std::monostate{};
  }
  const core::Duration shift =
      imu_shift(survey, topics, input) - core::Duration::from_milliseconds(config.imu.time_offset_ms);
  auto samples = drivers::open_bag_imu(bags, topics.imu, shift);
  if (!samples) return samples.error();
  input.samples = std::move(samples).value();
  input.notes.push_back("IMU " + input.samples->status());
  return std::monostate{};
}

Result<std::monostate> open_clouds(const std::vector<std::string>& bags, const BagTopics& topics,
                                   const Config& config, Input& input) {
  auto clouds = drivers::open_bag_clouds(bags, topics.lidar);
  if (!clouds) return clouds.error();
  const auto times = drivers::parse_point_times(config.recording.point_times);
  auto feed = CloudScanFeed::create(std::move(clouds).value(), topics.lidar,
                                    times.value_or(drivers::PointTimes::kAuto));
  if (!feed) return feed.error();
  for (const std::string& note : (*feed)->decoder().notes()) input.notes.push_back(note);
  for (const std::string& warning : (*feed)->decoder().warnings()) input.warnings.push_back(warning);
  input.first_stamp = (*feed)->first_stamp();
  input.scans = std::move(feed).value();
  return std::monostate{};
}

}  // namespace

std::string list_topics(const BagSurvey& survey) {
  std::string list;
  for (const BagTopicSurvey& topic : survey.topics) {
    std::string type = topic.topic.type.empty() ? "unknown type" : topic.topic.type;
    list += text("  %-32s %-32s ", printable(topic.topic.name).c_str(), printable(type).c_str());
    list += topic.rate_hz() > 0.0 ? text("%.1f Hz", topic.rate_hz())
                                  : text("%llu messages", static_cast<unsigned long long>(topic.messages));
    list += '\n';
  }
  return list.empty() ? "  (none)\n" : list;
}

Result<BagTopics> choose_bag_topics(const BagSurvey& survey, const Config& config, const std::string& bag,
                                    ImuPlace wanted) {
  auto lidar = choose(survey, config.recording.lidar_topic, "recording.lidar_topic",
                      {BagContent::kPackets, BagContent::kCloud}, bag);
  if (!lidar) return lidar.error();
  if (*lidar == nullptr)
    return Error{bag + ": no topic with a LiDAR's packets or point clouds; its topics:\n" +
                 list_topics(survey)};
  BagTopics topics;
  topics.lidar = (*lidar)->topic.name;
  topics.lidar_content = (*lidar)->content;
  const BagTopicSurvey* imu = nullptr;
  const bool reads_imu = wanted == ImuPlace::kBag && config.imu.enabled;
  if (reads_imu && config.imu.source == "hdl32e")
    return Error{"imu.source: hdl32e is read from captures, not from ROS bags - set auto or can"};
  if (reads_imu) {
    std::vector<BagContent> contents{BagContent::kCanFrame};
    if (config.imu.source == "auto") contents.insert(contents.begin(), BagContent::kImu);
    auto chosen = choose(survey, config.recording.imu_topic, "recording.imu_topic (or imu.enabled to false)",
                         contents, bag);
    if (!chosen) return chosen.error();
    imu = *chosen;
  }
  for (const BagTopicSurvey* const topic : {*lidar, imu}) {
    if (topic == nullptr) continue;
    if (const std::string problem = drivers::why_undecodable(topic->topic); !problem.empty())
      return Error{bag + ": " + problem + " - choose another topic, or convert the recording"};
  }
  if (imu != nullptr) {
    topics.imu = imu->topic.name;
    topics.imu_content = imu->content;
  }
  return topics;
}

Result<Input> open_bag_replay(const std::vector<std::string>& bags, const Config& config, ImuPlace imu) {
  auto survey = drivers::survey_bag(bags);
  if (!survey) return survey.error();
  Input input;
  for (const std::string& note : survey->notes) input.warnings.push_back(note);
  auto topics = choose_bag_topics(*survey, config, bags.front(), imu);
  if (!topics) return topics.error();
  input.notes.push_back("ROS bag " + bags.front() +
                        (bags.size() > 1 ? " and " + std::to_string(bags.size() - 1) + " more parts" : "") +
                        ": LiDAR " + topics->lidar + (topics->imu.empty() ? "" : ", IMU " + topics->imu));
  for (const ExtraLidarConfig& lidar : config.more_lidars) {
    if (lidar.enabled) {
      input.warnings.emplace_back(
          "more LiDARs are not merged from a ROS bag: their packets carry no addresses");
      break;
    }
  }
  if (topics->lidar_content == BagContent::kPackets) {
    const auto open = [&] { return drivers::open_bag_packets(bags, topics->lidar); };
    if (auto opened = open_recorded_packets(open, bags.front() + " " + topics->lidar, config, input); !opened)
      return opened.error();
  } else if (auto opened = open_clouds(bags, *topics, config, input); !opened) {
    return opened.error();
  }
  if (imu == ImuPlace::kBag) {
    if (auto opened = open_imu(bags, *survey, *topics, config, input); !opened) return opened.error();
  }
  if (auto found = find_extrinsics(*survey, *topics, config, input); !found) return found.error();
  return input;
}

}  // namespace nilio::daemon
