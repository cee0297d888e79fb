#include "ipc/dds/writers.hpp"

#include "ipc/dds/imu_pose_publisher.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/types.hpp"
#include "tests/support/dds_support.hpp"
#include "tests/support/paths.hpp"

#include <atomic>
#include <chrono>
#include <csignal>
#include <map>
#include <mutex>
#include <sstream>
#include <string>
#include <thread>

#include <catch2/catch.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/rtps/builtin/data/WriterProxyData.h>
#include <fastdds/rtps/writer/WriterDiscoveryInfo.h>

namespace {

namespace fastdds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;
using namespace nilio::dds;
using namespace nilio::tests;
using nilio::ipc::PublisherProcess;

/// Announcements of every discovered writer.
class Announcements : public fastdds::DomainParticipantListener {
 public:
  struct Announcement {
    std::string type;
    std::string user_data;
    double deadline_s = 0.0;
    double lease_s = 0.0;
  };

  void on_publisher_discovery(fastdds::DomainParticipant*, rtps::WriterDiscoveryInfo&& info) override {
    const std::lock_guard lock(mutex_);
    const auto& qos = info.info.m_qos;
    const auto& bytes = qos.m_userData.getValue();
    const auto seconds = [](const eprosima::fastrtps::Duration_t& duration) {
      return static_cast<double>(duration.to_ns()) * 1e-9;
    };
    writers_[info.info.topicName().to_string()] = {info.info.typeName().to_string(),
                                                   {bytes.begin(), bytes.end()},
                                                   seconds(qos.m_deadline.period),
                                                   seconds(qos.m_liveliness.lease_duration)};
  }
  std::map<std::string, Announcement> get() const {
    const std::lock_guard lock(mutex_);
    return writers_;
  }

 private:
  mutable std::mutex mutex_;
  std::map<std::string, Announcement> writers_;
};

/// Lines of the reader up to the first of this kind; empty at its end.
std::string await(Program& reader, const std::string& kind) {
  while (const auto line = reader.line()) {
    if (line->rfind(kind + " ", 0) == 0) return *line;
  }
  return "";
}

std::int64_t time_of(const std::string& line) {
  std::istringstream in(line);
  std::string kind;
  std::int64_t at = 0;
  in >> kind >> at;
  return at;
}

}  // namespace

TEST_CASE("type hashes are those of the IDL, and of ROS 2 where it has the type", "[writers]") {
  std::map<std::string, std::string> hashes;
  Program program("python3 " + source_folder() + "/tests/support/type_hashes.py " + source_folder() +
                  "/ipc/idl/nilio.idl 2>/dev/null");
  while (const auto line = program.line()) {
    const std::size_t space = line->find(' ');
    hashes[line->substr(0, space)] = line->substr(space + 1);
  }
  if (hashes.empty()) {
    WARN("skipped: no python3");
    return;
  }
  CHECK(OdometryType::type_hash() == hashes["nav_msgs/msg/Odometry"]);
  CHECK(TransformType::type_hash() == hashes["tf2_msgs/msg/TFMessage"]);
  CHECK(DiagnosticArrayType::type_hash() == hashes["diagnostic_msgs/msg/DiagnosticArray"]);
  CHECK(LatencyReportType::type_hash() == hashes["nilio/msg/LatencyReport"]);
  CHECK(ScanReportType::type_hash() == hashes["nilio/msg/ScanReport"]);
  CHECK(PointCloud2Type::type_hash() == hashes["sensor_msgs/msg/PointCloud2"]);
  CHECK(PathType::type_hash() == hashes["nav_msgs/msg/Path"]);
  CHECK(ImuPoseStatusType::type_hash() == hashes["nilio/msg/ImuPoseStatus"]);
  // Published by ROS 2 with its message packages.
  CHECK(hashes["nav_msgs/msg/Path"] ==
        "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b");
  CHECK(hashes["sensor_msgs/msg/PointCloud2"] ==
        "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5");
  CHECK(hashes["nav_msgs/msg/Odometry"] ==
        "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0");
  CHECK(hashes["diagnostic_msgs/msg/DiagnosticArray"] ==
        "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e");
}

TEST_CASE("every topic announces its type hash, a deadline and a liveliness", "[writers]") {
  const std::uint32_t domain = test_domain();
  Announcements announcements;
  auto observer = Participant::create(loopback(domain));
  REQUIRE(observer.ok());
  (*observer)->get().set_listener(&announcements, fastdds::StatusMask::none());
  OdometryPublisherConfig config;
  config.participant = loopback(domain);
  const auto publisher = make_publisher(domain);
  const auto imu_poses = ImuPosePublisher::create(*publisher, config);
  REQUIRE(imu_poses.ok());
  REQUIRE(eventually([&] { return announcements.get().size() == 7; }));
  for (const auto& [topic, writer] : announcements.get()) {
    INFO(topic);
    CHECK(writer.user_data.rfind("typehash=RIHS01_", 0) == 0);
    CHECK(writer.user_data.back() == ';');
    CHECK(writer.deadline_s >= 0.5);
    CHECK(writer.deadline_s <= 2.0);
    CHECK(writer.lease_s == Approx(2.0));
  }
  CHECK(announcements.get().at("rt/diagnostics").user_data ==
        "typehash=" + std::string(DiagnosticArrayType::type_hash()) + ";");
}

TEST_CASE("readers with default QoS and readers that request the promises are told that the publisher died",
          "[writers][timed]") {
  const auto executable = built_program("nilio-publisher");
  const auto cyclone = built_program("nilio-cyclone-reader");
  if (!executable || !cyclone) return;
  const std::uint32_t domain = test_domain();
  const auto mode = GENERATE("arrivals", "promises");
  Program reader(kCycloneLoopback + cyclone->string() + " " + std::to_string(domain) + " 1000000 20 " + mode);
  auto process = PublisherProcess::create(process_config(*executable, domain));
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  std::atomic<bool> publishing{true};
  std::thread producer([&] {
    for (std::uint64_t i = 0; publishing; ++i) {
      (*process)->publish(sample_record(i));
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  });
  const std::string arrival = await(reader, "arrival");
  publishing = false;
  producer.join();
  REQUIRE_FALSE(arrival.empty());
  const std::int64_t killed = monotonic_ns();
  kill((*process)->pid(), SIGKILL);
  if (std::string(mode) == "promises") {
    const std::int64_t overdue = time_of(await(reader, "deadline"));
    CHECK(overdue - killed > 0);
    CHECK(overdue - killed < 1'500'000'000);
  }
  const std::string alive = await(reader, "alive");
  INFO(alive);
  const double noticed_s = static_cast<double>(time_of(alive) - killed) * 1e-9;
  CHECK(noticed_s > 0.0);
  CHECK(noticed_s < 3.0);
}
