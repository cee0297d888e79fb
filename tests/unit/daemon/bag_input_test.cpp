#include "daemon/input/bag_input.hpp"

#include "daemon/input/replay_files.hpp"
#include "tests/support/temporary_folder.hpp"

#include <fstream>
#include <string>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::daemon;
using drivers::BagContent;

drivers::BagTopicSurvey topic(const std::string& name, const std::string& type, double rate_hz) {
  drivers::BagTopicSurvey survey;
  survey.topic.name = name;
  survey.topic.type = type;
  survey.topic.encoding = drivers::BagEncoding::kRos1;
  survey.content = drivers::content_of(survey.topic);
  survey.messages = 101;
  survey.last = survey.first + core::Duration::from_seconds(100.0 / rate_hz);
  return survey;
}

const drivers::BagTopicSurvey kPoints = topic("/points", "sensor_msgs/PointCloud2", 10.0);
const drivers::BagTopicSurvey kOtherPoints = topic("/filtered", "sensor_msgs/PointCloud2", 5.0);
const drivers::BagTopicSurvey kPackets = topic("/velodyne_packets", "velodyne_msgs/VelodyneScan", 10.0);
const drivers::BagTopicSurvey kImu = topic("/imu", "sensor_msgs/Imu", 200.0);
const drivers::BagTopicSurvey kCan = topic("/can0", "can_msgs/Frame", 400.0);

drivers::BagSurvey survey_of(std::vector<drivers::BagTopicSurvey> topics) {
  drivers::BagSurvey survey;
  survey.topics = std::move(topics);
  return survey;
}

void write_bag(const std::filesystem::path& path) { std::ofstream(path) << "#ROSBAG V2.0\n"; }

}  // namespace

TEST_CASE("topics of a bag are chosen by their type, packets and IMU messages first", "[bag_input]") {
  const auto topics = choose_bag_topics(survey_of({kCan, kPoints, kImu, kPackets}), Config{}, "drive.bag");
  REQUIRE(topics.ok());
  CHECK(topics->lidar == "/velodyne_packets");
  CHECK(topics->imu == "/imu");
  Config config;
  config.imu.source = "can";
  config.recording.lidar_topic = "/points";
  const auto configured = choose_bag_topics(survey_of({kCan, kPoints, kImu, kPackets}), config, "drive.bag");
  REQUIRE(configured.ok());
  CHECK(configured->lidar == "/points");
  CHECK(configured->lidar_content == BagContent::kCloud);
  CHECK(configured->imu == "/can0");
  CHECK(choose_bag_topics(survey_of({kPoints}), Config{}, "drive.bag")->imu.empty());
}

TEST_CASE("ambiguous, missing and unsuitable topics are errors with all topics and rates", "[bag_input]") {
  const auto message = [](const drivers::BagSurvey& survey, const Config& config) {
    const auto topics = choose_bag_topics(survey, config, "drive.bag");
    REQUIRE_FALSE(topics.ok());
    return topics.error().message;
  };
  CHECK_THAT(message(survey_of({kPoints, kOtherPoints}), {}),
             Catch::Contains("set recording.lidar_topic") && Catch::Contains("/filtered") &&
                 Catch::Contains("5.0 Hz") && Catch::Contains("10.0 Hz"));
  CHECK_THAT(message(survey_of({kImu}), {}), Catch::Contains("no topic with a LiDAR's packets"));
  Config config;
  config.recording.lidar_topic = "/lidar";
  CHECK_THAT(message(survey_of({kPoints}), config), Catch::Contains("'/lidar' is not in the recording"));
  config.recording.lidar_topic = "/imu";
  CHECK_THAT(message(survey_of({kPoints, kImu}), config), Catch::Contains("messages of another kind"));
  config = {};
  config.imu.source = "hdl32e";
  CHECK_THAT(message(survey_of({kPackets}), config), Catch::Contains("imu.source"));
  auto renamed = kPoints;
  renamed.topic.md5 = "0123";
  CHECK_THAT(message(survey_of({renamed}), {}), Catch::Contains("another definition"));
}

TEST_CASE("names of topics cannot control the terminal", "[bag_input]") {
  const std::string list = list_topics(survey_of({topic("/a\x1B[2J\n", "sensor_msgs/Imu\x7F", 1.0)}));
  CHECK(list.find('\x1B') == std::string::npos);
  CHECK_THAT(list, Catch::Contains("/a?[2J?") && Catch::Contains("sensor_msgs/Imu?"));
}

TEST_CASE("parts of one bag are one recording, other bags have to be named", "[bag_input]") {
  const tests::TemporaryFolder folder;
  write_bag(folder.path() / "drive_0.bag");
  write_bag(folder.path() / "drive_10.bag");
  // An output of niliod.
  std::ofstream(folder.path() / "run.mcap") << "\x89MCAP0\r\n";
  const auto parts = find_replay_files({folder.path().string()});
  REQUIRE(parts.ok());
  CHECK(parts->bags.size() == 2);
  write_bag(folder.path() / "other.bag");
  const auto mixed = find_replay_files({folder.path().string()});
  REQUIRE_FALSE(mixed.ok());
  CHECK_THAT(mixed.error().message, Catch::Contains("name the one to replay"));
  CHECK(find_replay_files({(folder.path() / "other.bag").string()})->bags.size() == 1);
}
