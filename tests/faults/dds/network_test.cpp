#include "ipc/dds/types.hpp"
#include "ipc/publisher_process.hpp"
#include "tests/support/dds_support.hpp"
#include "tests/support/network_hosts.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>
#include <sstream>
#include <string>
#include <thread>

#include <catch2/catch.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

namespace {

namespace fastdds = eprosima::fastdds::dds;
using namespace nilio::tests;
using nilio::ipc::PublisherEvent;
using nilio::ipc::PublisherProcess;
using nilio::ipc::PublisherProcessConfig;

// Configuration that ROS 2 gives CycloneDDS with ROS_LOCALHOST_ONLY=1.
constexpr const char* kRosLocalhost =
    "CYCLONEDDS_URI='<CycloneDDS><Domain><General><Interfaces><NetworkInterface address=\"127.0.0.1\"/>"
    "</Interfaces></General></Domain></CycloneDDS>' ";

/// The reader ends after 25 s at the latest; the test needs 10.
std::string reader_command(const std::string& program, std::uint32_t domain, const char* mode) {
  return program + " " + std::to_string(domain) + " 1000000 25 " + mode + " 2>/dev/null";
}

/// Time in the next line of this kind.
std::int64_t await(Program& reader, const std::string& wanted) {
  while (const auto line = reader.line()) {
    std::istringstream in(*line);
    std::string kind;
    std::int64_t at = 0;
    in >> kind >> at;
    if (kind == wanted) return at;
  }
  return 0;
}

/// Reader of the odometry as ROS 2 Humble makes it with Fast DDS and ROS_LOCALHOST_ONLY=1: transport bound to
/// 127.0.0.1, no peers, default QoS.
class RosLocalhostReader : public fastdds::DataReaderListener {
 public:
  explicit RosLocalhostReader(std::uint32_t domain) {
    fastdds::DomainParticipantQos qos;
    qos.transport().use_builtin_transports = false;
    const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    udp->interfaceWhiteList.emplace_back("127.0.0.1");
    qos.transport().user_transports.push_back(udp);
    participant_ = fastdds::DomainParticipantFactory::get_instance()->create_participant(domain, qos);
    REQUIRE(participant_ != nullptr);
    const fastdds::TypeSupport type(new nilio::dds::OdometryType);
    type.register_type(participant_);
    fastdds::Topic* const topic =
        participant_->create_topic("rt/odom", type.get_type_name(), fastdds::TOPIC_QOS_DEFAULT);
    fastdds::DataReaderQos reader_qos;
    reader_qos.reliability().kind = fastdds::RELIABLE_RELIABILITY_QOS;
    reader_qos.data_sharing().off();
    reader_ = participant_->create_subscriber(fastdds::SUBSCRIBER_QOS_DEFAULT)
                  ->create_datareader(topic, reader_qos, this);
    REQUIRE(reader_ != nullptr);
  }
  ~RosLocalhostReader() override {
    reader_->set_listener(nullptr);
    participant_->delete_contained_entities();
    fastdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
  }
  RosLocalhostReader(const RosLocalhostReader&) = delete;
  RosLocalhostReader& operator=(const RosLocalhostReader&) = delete;

  void on_data_available(fastdds::DataReader* reader) override {
    nilio::dds::Odometry message;
    fastdds::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
      std::int64_t expected = 0;
      if (info.valid_data) first_ns_.compare_exchange_strong(expected, monotonic_ns());
    }
  }
  /// CLOCK_MONOTONIC of the first message.
  [[nodiscard]] std::int64_t first() const {
    REQUIRE(eventually([this] { return first_ns_.load() != 0; }));
    return first_ns_.load();
  }

 private:
  fastdds::DomainParticipant* participant_ = nullptr;
  fastdds::DataReader* reader_ = nullptr;
  std::atomic<std::int64_t> first_ns_{0};
};

/// nilio-publisher with 10 poses per second, supervised as by niliod.
class PublishingHost {
 public:
  PublishingHost(NetworkHost& host, PublisherProcessConfig config) : host_(host) {
    thread_ = std::thread([this, config] { host_.run([&] { run(config); }); });
  }
  ~PublishingHost() {
    stopping_ = true;
    thread_.join();
  }
  PublishingHost(const PublishingHost&) = delete;
  PublishingHost& operator=(const PublishingHost&) = delete;

  /// CLOCK_MONOTONIC before the first start.
  [[nodiscard]] std::int64_t started() const {
    REQUIRE(eventually([this] { return pid_.load() > 0; }));
    return started_ns_;
  }
  void kill_publisher() {
    const std::int64_t restarted_before = restarted_ns_;
    kill(pid_, SIGKILL);
    REQUIRE(eventually([&] { return restarted_ns_.load() != restarted_before; }));
  }
  [[nodiscard]] std::int64_t restarted() const { return restarted_ns_; }

 private:
  void run(const PublisherProcessConfig& config) {
    auto process = PublisherProcess::create(config);
    if (!process) return;
    started_ns_ = monotonic_ns();
    if (const auto pid = (*process)->start()) pid_ = *pid;
    std::uint64_t sequence = 0;
    for (int tick = 0; !stopping_; ++tick) {
      if (tick % 5 == 0) (*process)->publish(sample_record(sequence++));
      if (const auto event = (*process)->poll(); event && event->kind == PublisherEvent::Kind::kStarted) {
        pid_ = event->pid;
        restarted_ns_ = monotonic_ns();
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    (*process)->stop();
  }

  NetworkHost& host_;
  std::atomic<bool> stopping_{false};
  std::atomic<pid_t> pid_{-1};
  std::atomic<std::int64_t> started_ns_{0};
  std::atomic<std::int64_t> restarted_ns_{0};
  std::thread thread_;
};

constexpr double kNsPerSecond = 1e9;

}  // namespace

TEST_CASE("readers that run already, on the network and bound to localhost, get the first pose within 2 s",
          "[network][timed]") {
  const auto publisher = built_program("nilio-publisher");
  const auto cyclone = built_program("nilio-cyclone-reader");
  if (!publisher || !cyclone) return;
  TwoHosts hosts;
  if (const std::string reason = hosts.connect(); !reason.empty()) {
    WARN("skipped: " << reason);
    return;
  }
  const std::uint32_t domain = test_domain();
  std::unique_ptr<Program> network_reader;
  std::unique_ptr<Program> localhost_reader;
  std::unique_ptr<RosLocalhostReader> fastdds_reader;
  hosts.second.run(
      [&] { network_reader = std::make_unique<Program>(reader_command(*cyclone, domain, "arrivals")); });
  hosts.first.run([&] {
    localhost_reader =
        std::make_unique<Program>(kRosLocalhost + reader_command(*cyclone, domain, "arrivals"));
    fastdds_reader = std::make_unique<RosLocalhostReader>(domain);
  });
  REQUIRE(await(*network_reader, "waiting") > 0);
  REQUIRE(await(*localhost_reader, "waiting") > 0);
  std::this_thread::sleep_for(std::chrono::seconds(2));  // first announcements of the readers are over

  PublisherProcessConfig config;  // nothing but defaults
  config.executable = *publisher;
  config.domain = domain;
  config.nice = 0;
  {
    PublishingHost host(hosts.first, config);
    const std::int64_t started = host.started();
    const auto seconds = [](std::int64_t from, std::int64_t to) {
      return static_cast<double>(to - from) / kNsPerSecond;
    };
    const double network_s = seconds(started, await(*network_reader, "arrival"));
    const double localhost_s = seconds(started, await(*localhost_reader, "arrival"));
    const double fastdds_s = seconds(started, fastdds_reader->first());
    WARN("first pose after " << network_s << " s (network), " << localhost_s
                             << " s (CycloneDDS on localhost), " << fastdds_s
                             << " s (Fast DDS on localhost)");
    CHECK((network_s > 0.0 && network_s <= 2.0));
    CHECK((localhost_s > 0.0 && localhost_s <= 2.0));
    CHECK((fastdds_s > 0.0 && fastdds_s <= 2.0));

    std::this_thread::sleep_for(std::chrono::milliseconds(1500));
    const std::int64_t killed = monotonic_ns();
    host.kill_publisher();
    CHECK(seconds(killed, host.restarted()) <= 1.0);
    std::int64_t arrival = 0;
    while (arrival < host.restarted()) {
      arrival = await(*network_reader, "arrival");
      REQUIRE(arrival > 0);
    }
    const double again_s = seconds(killed, arrival);
    WARN("killed: restarted after " << seconds(killed, host.restarted()) << " s, pose after " << again_s
                                    << " s");
    CHECK(again_s <= 3.0);
  }
  hosts.first.run([&] {
    fastdds_reader.reset();
    localhost_reader.reset();
  });
  network_reader.reset();
}
