#include "ipc/dds/filtered_transport.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/dds/participant.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/dds/types.hpp"
#include "ipc/histogram.hpp"
#include "ipc/messages/diagnostics.hpp"
#include "ipc/publisher_process.hpp"
#include "tests/support/dds_support.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <memory>
#include <netinet/in.h>
#include <optional>
#include <sstream>
#include <string>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <catch2/catch.hpp>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>

namespace {

using namespace nilio::dds;
using nilio::core::Duration;
using nilio::core::Time;
using nilio::ipc::PoseRecord;
using nilio::ipc::PublisherEvent;
using nilio::ipc::PublisherProcess;
using nilio::ipc::PublisherProcessConfig;
using namespace nilio::tests;
using Clock = std::chrono::steady_clock;

/// Gyro in degrees instead of radians.
PoseRecord record_with_bad_imu() {
  PoseRecord record;
  record.state = nilio::core::TrackingState::kTracking;
  record.has_imu = true;
  nilio::core::ImuDiagnosis& scale =
      record.imu_health.rows[static_cast<std::size_t>(nilio::core::ImuCheck::kGyroScale)];
  scale.value = 57.3;
  scale.state = nilio::core::ImuCheckState::kBad;
  record.imu_health.reason = nilio::core::ImuCheck::kGyroScale;
  return record;
}

Odometry expected_odometry(std::uint64_t sequence) {
  Odometry odometry;
  odometry.frame_id = "odom";
  odometry.child_frame_id = "base_link";
  fill_odometry(sample_record(sequence), odometry);
  return odometry;
}

TransformStamped parse_transform(std::istream& in) {
  TransformStamped transform;
  transform.stamp = read_stamp(in);
  in >> transform.frame_id >> transform.child_frame_id;
  read_numbers(in, transform.translation);
  read_numbers(in, transform.rotation_xyzw);
  return transform;
}

}  // namespace

TEST_CASE("a subscriber on the same machine receives every pose with every field, in order", "[transport]") {
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  const auto publisher = make_publisher(domain);
  REQUIRE(wait_for_subscriber(*publisher));
  for (std::uint64_t i = 0; i < 50; ++i) {
    REQUIRE(publisher->publish_odometry(sample_record(i)));
    REQUIRE(publisher->publish_transform(sample_record(i)));
    const auto received = subscriber->next(kPatience);
    REQUIRE(received.has_value());
    CHECK(received->message == expected_odometry(i));
    CHECK(received->written.ns > 0);
    CHECK(received->received >= received->written);
  }
  const SubscriberCounts counts = subscriber->counts();
  CHECK(counts.received == 50);
  CHECK(counts.lost == 0);
  CHECK(counts.writers_seen == 1);
  CHECK(counts.publishers == 1);
}

TEST_CASE("a latency report arrives unchanged", "[transport]") {
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  const auto publisher = make_publisher(domain);
  REQUIRE(wait_for_subscriber(*publisher));
  CHECK_FALSE(subscriber->latency_report().has_value());
  LatencyReport report;
  report.stamp = {123'456'789'012};
  report.stages = {{"write", 3, 1.0, 1.5, 2.0, 2.5, 3.0, {{0.5, 1.0, 2}, {2.0, 4.0, 1}}}};
  report.ring_dropped = 17;
  std::optional<LatencyReport> received;
  // The reports' own reader may be discovered a little later.
  REQUIRE(eventually([&] {
    REQUIRE(publisher->publish_latency(report));
    received = subscriber->latency_report();
    return received.has_value();
  }));
  CHECK(*received == report);
}

TEST_CASE("diagnostics contain the IMU's problem and the age of the last pose", "[transport]") {
  const PoseRecord record = record_with_bad_imu();
  const DiagnosticArray fresh = make_diagnostics({record, Duration::from_milliseconds(100.0)}, Time{7});
  REQUIRE(fresh.statuses.size() == 5);
  CHECK(fresh.stamp == Time{7});
  CHECK(fresh.statuses[0].level == DiagnosticStatus::Level::kOk);
  const DiagnosticStatus& imu = fresh.statuses.back();
  CHECK(imu.name == "nilio: IMU");
  CHECK(imu.level == DiagnosticStatus::Level::kError);
  CHECK(imu.message.find("not used because of gyro_scale; gyro_scale: rates are in deg/s") == 0);
  const auto& values = imu.values;
  const auto scale =
      std::find_if(values.begin(), values.end(), [](const KeyValue& v) { return v.key == "gyro_scale"; });
  REQUIRE(scale != values.end());
  CHECK(scale->value == "57.3 1, bad");

  const DiagnosticArray stale = make_diagnostics({record, Duration::from_seconds(2.5)}, Time{7});
  CHECK(stale.statuses[0].level == DiagnosticStatus::Level::kStale);
  CHECK(stale.statuses[0].message.find("pose age: no pose for 2.5 s - read niliod's line") == 0);
  CHECK(make_diagnostics({PoseRecord{}, Duration{}}, Time{}).statuses.size() == 4);
}

TEST_CASE("diagnostics arrive unchanged", "[transport]") {
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  const auto publisher = make_publisher(domain);
  REQUIRE(wait_for_subscriber(*publisher));
  const PoseRecord bad_imu = record_with_bad_imu();
  const DiagnosticArray sent = make_diagnostics({bad_imu, Duration{}}, Time{5});
  std::optional<DiagnosticArray> received;
  REQUIRE(eventually([&] {
    REQUIRE(publisher->publish_diagnostics(sent));
    received = subscriber->diagnostics();
    return received.has_value();
  }));
  CHECK(*received == sent);
}

TEST_CASE("malformed messages of another writer do not disturb the subscriber", "[transport]") {
  namespace fastdds = eprosima::fastdds::dds;
  // Announces itself as odometry and sends a frame name that claims more bytes than present.
  class GarbageType : public OdometryType {
   public:
    bool serialize(void*, Payload* payload) override {
      const std::array<std::uint8_t, 24> bytes{0, 1, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0x7F};
      std::copy(bytes.begin(), bytes.end(), payload->data);
      payload->length = bytes.size();
      return true;
    }
  };
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  auto vandal = Participant::create(loopback(domain));
  REQUIRE(vandal.ok());
  const fastdds::TypeSupport type(new GarbageType);
  type.register_type(&(*vandal)->get());
  fastdds::Topic* const topic =
      (*vandal)->get().create_topic("rt/odom", type.get_type_name(), fastdds::TOPIC_QOS_DEFAULT);
  fastdds::DataWriter* const writer = (*vandal)
                                          ->get()
                                          .create_publisher(fastdds::PUBLISHER_QOS_DEFAULT)
                                          ->create_datawriter(topic, fastdds::DATAWRITER_QOS_DEFAULT);
  REQUIRE(writer != nullptr);
  const auto publisher = make_publisher(domain);
  REQUIRE(wait_for_subscriber(*publisher));
  REQUIRE(eventually([writer] {
    fastdds::PublicationMatchedStatus matched;
    writer->get_publication_matched_status(matched);
    return matched.current_count == 1;
  }));
  Odometry anything;
  for (std::uint64_t i = 0; i < 300; ++i) {
    CHECK(writer->write(&anything));
    REQUIRE(publisher->publish_odometry(sample_record(i)));
    const auto received = subscriber->next(kPatience);
    REQUIRE(received.has_value());
    CHECK(received->message.stamp.ns == sample_record(i).stamp_ns);
  }
  CHECK(subscriber->counts().received == 300);
}

TEST_CASE("CycloneDDS reads odometry, transform and diagnostics from the IDL with equal fields",
          "[transport]") {
  const auto reader_program = built_program("nilio-cyclone-reader");
  if (!reader_program) return;
  const std::uint32_t domain = test_domain();
  constexpr std::uint64_t message_count = 20;
  const auto publisher = make_publisher(domain);
  Program reader(kCycloneLoopback + reader_program->string() + " " + std::to_string(domain) + " " +
                 std::to_string(message_count) + " 30");
  REQUIRE(wait_for_subscriber(*publisher));
  REQUIRE(eventually([&] { return publisher->transform_subscribers() == 1; }));
  // Both sides discover each other independently; a volatile CycloneDDS reader ignores samples from before
  // its own discovery.
  REQUIRE(reader.line() == "ready");
  for (std::uint64_t i = 0; i < message_count; ++i) {
    REQUIRE(publisher->publish_odometry(sample_record(i)));
    REQUIRE(publisher->publish_transform(sample_record(i)));
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const PoseRecord bad_imu = record_with_bad_imu();
  const DiagnosticArray diagnostics = make_diagnostics({bad_imu, Duration{}}, Time{1});
  REQUIRE(publisher->publish_diagnostics(diagnostics));
  std::uint64_t odometries = 0;
  std::uint64_t transforms = 0;
  std::size_t statuses = 0;
  while (const auto line = reader.line()) {
    std::istringstream in(*line);
    std::string kind;
    in >> kind;
    if (kind == "odometry") {
      CHECK(parse_odometry(in) == expected_odometry(odometries++));
    } else if (kind == "diagnostics") {
      REQUIRE(statuses < diagnostics.statuses.size());
      const DiagnosticStatus& status = diagnostics.statuses[statuses++];
      std::string expected = "diagnostics " + std::to_string(static_cast<int>(status.level)) + " [" +
                             status.name + "] [" + status.message + "]";
      for (const KeyValue& value : status.values) expected += " [" + value.key + "=" + value.value + "]";
      CHECK(*line == expected);
    } else if (kind == "transform") {
      const PoseRecord record = sample_record(transforms++);
      CHECK(
          parse_transform(in) ==
          TransformStamped{{record.stamp_ns}, "odom", "base_link", record.position, record.orientation_xyzw});
    }
  }
  CHECK(odometries == message_count);
  CHECK(transforms == message_count);
  CHECK(statuses == diagnostics.statuses.size());
  CHECK(reader.exit_status() == 0);
}

TEST_CASE("a publisher process publishes the ring's content before it ends, however early it is stopped",
          "[transport]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  PublisherProcessConfig config = process_config(*executable, domain);
  config.wait_for_subscribers = kPatience;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  constexpr std::uint64_t pose_count = 200;
  for (std::uint64_t i = 0; i < pose_count; ++i) REQUIRE((*process)->publish(sample_record(i)));
  REQUIRE((*process)->start().ok());
  const auto stopped = (*process)->stop(kPatience);
  REQUIRE(stopped.has_value());
  INFO(stopped->message);
  CHECK(stopped->exit_status == 0);
  CHECK(stopped->unpublished == 0);
  std::uint64_t expected = 0;
  while (const auto received = subscriber->next(Duration::from_seconds(1.0)))
    CHECK(received->message == expected_odometry(expected++));
  CHECK(expected == pose_count);
  CHECK(subscriber->counts().lost == 0);
  const auto report = subscriber->latency_report();
  REQUIRE(report.has_value());
  CHECK(report->poses_published == pose_count);
  CHECK(report->failed_writes == 0);
  REQUIRE(report->stages.size() == nilio::ipc::kLatencyStageCount - 1 + 3);
  CHECK(report->stages[1].p50_us == Approx(1000.0).epsilon(0.01));
  CHECK(report->stages.back().name == "received_to_written");
  CHECK(report->stages.back().count >= pose_count);
}

TEST_CASE("a publisher killed with SIGKILL is restarted within a second and loses no pose",
          "[transport][timed]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  PublisherProcessConfig config = process_config(*executable, domain);
  config.wait_for_subscribers = kPatience;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());

  std::uint64_t sequence = 0;
  std::uint64_t expected = 0;
  std::uint64_t repeated = 0;
  bool killed = false;
  int outages = 0;
  std::vector<double> pauses_ms;
  const auto limit = Clock::now() + std::chrono::minutes(2);
  while (outages < 3 && Clock::now() < limit) {
    REQUIRE((*process)->publish(sample_record(sequence++)));
    const auto event = (*process)->poll();
    if (event && event->kind == PublisherEvent::Kind::kDied) pauses_ms.push_back(event->pause.milliseconds());
    const auto next_pose = Clock::now() + std::chrono::milliseconds(20);
    while (const auto received = subscriber->next(Duration{(next_pose - Clock::now()).count()})) {
      const auto stamp = received->message.stamp.ns;
      if (expected > 0 && stamp == sample_record(expected - 1).stamp_ns) {
        ++repeated;  // written, but not yet consumed when the process was killed
        continue;
      }
      CHECK(stamp == sample_record(expected++).stamp_ns);
      if (!killed || (*process)->restarts() <= static_cast<std::uint64_t>(outages)) continue;
      ++outages;
      killed = false;
    }
    if (!killed && sequence % 100 == 50) {
      kill((*process)->pid(), SIGKILL);
      killed = true;
    }
  }
  REQUIRE(outages == 3);
  REQUIRE(pauses_ms.size() == 3);
  for (const double pause_ms : pauses_ms) CHECK(pause_ms <= 1000.0);
  CHECK(repeated <= 3);
  CHECK((*process)->restarts() == 3);
  CHECK(subscriber->counts().writers_seen == 4);
  CHECK((*process)->ring().dropped() == 0);
}

TEST_CASE("a statistics datagram that aborts Fast DDS 2.9.1 is filtered out", "[transport]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  const std::uint32_t domain = test_domain();
  const auto subscriber = make_subscriber(domain);
  PublisherProcessConfig config = process_config(*executable, domain);
  config.wait_for_subscribers = kPatience;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  REQUIRE((*process)->publish(sample_record(0)));
  REQUIRE(subscriber->next(kPatience).has_value());

  // RTPS 2.3 of eProsima, then two statistics submessages of the right length where only one, the last, is
  // expected.
  std::vector<std::uint8_t> datagram{'R', 'T', 'P', 'S', 2, 3, 1, 15};
  datagram.insert(datagram.end(), 12, 0x42);
  for (int i = 0; i < 2; ++i) {
    datagram.insert(datagram.end(), {0x80, 0x01, 56, 0});
    datagram.insert(datagram.end(), 56, 0);
  }
  // The same behind a submessage whose length is no multiple of four, which Fast DDS rounds up.
  std::vector<std::uint8_t> unaligned(datagram.begin(), datagram.begin() + 20);
  unaligned.insert(unaligned.end(), {0x0F, 0x01, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  unaligned.insert(unaligned.end(), datagram.begin() + 20, datagram.end());
  CHECK(harmless_bytes(datagram.data(), datagram.size()) == 20);
  CHECK(harmless_bytes(unaligned.data(), unaligned.size()) == 32);
  const int sender = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (std::uint32_t offset = 10; offset < 30; ++offset) {  // ports of the domain's first participants
    to.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain + offset));
    for (const auto& bytes : {datagram, unaligned})
      sendto(sender, bytes.data(), bytes.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  close(sender);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  const auto event = (*process)->poll();
  INFO((event ? event->message : ""));
  CHECK_FALSE(event.has_value());
  REQUIRE((*process)->publish(sample_record(1)));
  const auto received = subscriber->next(kPatience);
  REQUIRE(received.has_value());
  CHECK(received->message == expected_odometry(1));
}

TEST_CASE("heartbeats and gaps that would occupy Fast DDS for minutes are filtered out", "[transport]") {
  const auto bytes_of = [](std::uint8_t kind, bool little_endian, std::uint64_t first, std::uint64_t second) {
    std::vector<std::uint8_t> datagram{'R', 'T', 'P', 'S', 2, 3, 1, 15};
    datagram.insert(datagram.end(), 12, 0x42);
    datagram.insert(datagram.end(), {0x09, 0x01, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0});  // time stamp
    datagram.insert(datagram.end(), {kind, static_cast<std::uint8_t>(little_endian ? 1 : 0),
                                     static_cast<std::uint8_t>(little_endian ? 28 : 0),
                                     static_cast<std::uint8_t>(little_endian ? 0 : 28)});
    datagram.insert(datagram.end(), 8, 0x42);
    for (const std::uint64_t number : {first, second}) {
      for (const std::uint64_t word : {number >> 32U, number & 0xFFFF'FFFFU}) {
        for (unsigned i = 0; i < 4; ++i)
          datagram.push_back(static_cast<std::uint8_t>(word >> 8 * (little_endian ? i : 3 - i)));
      }
    }
    datagram.insert(datagram.end(), 4, 0);
    return datagram.size() - harmless_bytes(datagram.data(), datagram.size());
  };
  constexpr std::uint8_t heartbeat = 0x07;
  constexpr std::uint8_t gap = 0x08;
  for (const bool little_endian : {true, false}) {
    INFO("little endian " << little_endian);
    CHECK(bytes_of(heartbeat, little_endian, 1, 0) == 0);
    CHECK(bytes_of(heartbeat, little_endian, 900'000, 1'000'000) == 0);
    CHECK(bytes_of(gap, little_endian, 100, 60'000) == 0);
    CHECK(bytes_of(heartbeat, little_endian, 1, 0x7FFF'FFFF) == 32);
    CHECK(bytes_of(heartbeat, little_endian, std::uint64_t{1} << 40U, 5) == 32);
    CHECK(bytes_of(heartbeat, little_endian, 1, ~std::uint64_t{0}) == 32);
    CHECK(bytes_of(gap, little_endian, 1, 1'000'000) == 32);
    CHECK(bytes_of(gap, little_endian, std::uint64_t{1} << 62U, (std::uint64_t{1} << 62U) + 1) == 32);
  }
}

TEST_CASE("an announcement in the name of another participant is filtered out", "[transport]") {
  using Bytes = std::vector<std::uint8_t>;
  const auto append = [](Bytes& to, const Bytes& bytes) { to.insert(to.end(), bytes.begin(), bytes.end()); };
  const auto guid = [](std::uint8_t participant) {
    Bytes bytes(12, participant);
    bytes.insert(bytes.end(), {0, 0, 1, 0xC1});
    return bytes;
  };
  struct Announcement {
    std::uint8_t header = 1;  ///< participant
    std::uint8_t payload = 1;
    std::optional<std::uint8_t> info_source{};
    std::optional<std::uint8_t> key{};  ///< in the inline QoS
    std::uint8_t writer = 0xC2;         ///< SPDP
    std::uint8_t kind = 0x15;           ///< data
  };
  const auto is_filtered = [&](const Announcement& announcement) {
    Bytes datagram{'R', 'T', 'P', 'S', 2, 3, 1, 15};
    append(datagram, Bytes(12, announcement.header));
    if (announcement.info_source) {
      append(datagram, {0x0C, 0x01, 20, 0, 0, 0, 0, 0, 2, 3, 1, 15});
      append(datagram, Bytes(12, *announcement.info_source));
    }
    Bytes body{0, 0, 16, 0, 0, 0, 0, 0, 0, 1, 0, announcement.writer, 0, 0, 0, 0, 1, 0, 0, 0};
    if (announcement.kind == 0x16) append(body, {1, 0, 0, 0, 1, 0, 64, 0, 64, 0, 0, 0});
    if (announcement.key) {
      append(body, {0x70, 0, 16, 0});
      append(body, guid(*announcement.key));
      append(body, {1, 0, 0, 0});
    }
    append(body, {0, 3, 0, 0, 0x15, 0, 4, 0, 2, 3, 0, 0, 0x50, 0, 16, 0});  // version, participant
    append(body, guid(announcement.payload));
    append(body, {1, 0, 0, 0});
    const std::size_t begin = datagram.size();
    const std::uint8_t flags = announcement.key ? 0x07 : 0x05;
    append(datagram, {announcement.kind, flags, static_cast<std::uint8_t>(body.size()), 0});
    append(datagram, body);
    const std::size_t harmless = harmless_bytes(datagram.data(), datagram.size());
    CHECK((harmless == begin || harmless == datagram.size()));
    return harmless == begin;
  };
  CHECK_FALSE(is_filtered({}));
  CHECK_FALSE(is_filtered({.key = 1}));
  CHECK_FALSE(is_filtered({.header = 2, .info_source = 1}));
  CHECK(is_filtered({.header = 2}));
  CHECK(is_filtered({.payload = 2}));
  CHECK(is_filtered({.info_source = 2}));
  CHECK(is_filtered({.key = 2}));
  CHECK(is_filtered({.kind = 0x16}));
  // Data of other writers is not about a participant.
  CHECK_FALSE(is_filtered({.payload = 2, .writer = 0xC7}));
}

TEST_CASE("a participant is heard although its announcement was forged before it came", "[transport]") {
  const std::uint32_t domain = test_domain();
  const auto publisher = make_publisher(domain);
  // Participants of a process have consecutive numbers: the next one's prefix is known.
  std::array<std::uint8_t, 12> next{};
  const auto& last = publisher->participant().get().guid().guidPrefix;
  std::copy(std::begin(last.value), std::end(last.value), next.begin());
  ++next[8];
  std::vector<std::uint8_t> datagram{'R', 'T', 'P', 'S', 2, 3, 1, 15};
  datagram.insert(datagram.end(), next.begin(), next.end());
  // Announcement number 1000 of nobody in particular.
  datagram.insert(datagram.end(), {0x15, 0x05, 48,   0, 0, 0, 16, 0, 0, 0, 0,    0,    0,  1, 0, 0xC2, 0, 0,
                                   0,    0,    0xE8, 3, 0, 0, 0,  3, 0, 0, 0x50, 0,    16, 0, 9, 9,    9, 9,
                                   9,    9,    9,    9, 9, 9, 9,  9, 0, 0, 1,    0xC1, 1,  0, 0, 0});
  const int sender = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  for (std::uint32_t offset = 10; offset < 30; offset += 2) {  // discovery ports of the first participants
    to.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain + offset));
    sendto(sender, datagram.data(), datagram.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to);
  }
  close(sender);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  const auto subscriber = make_subscriber(domain);
  REQUIRE(wait_for_subscriber(*publisher));
}

TEST_CASE("data whose inline QoS is longer than the submessage is filtered out", "[transport]") {
  const auto filtered = [](std::vector<std::uint8_t> submessage) {
    std::vector<std::uint8_t> datagram{'R', 'T', 'P', 'S', 2, 3, 1, 15};
    datagram.insert(datagram.end(), 12, 0x42);
    datagram.insert(datagram.end(), submessage.begin(), submessage.end());
    return harmless_bytes(datagram.data(), datagram.size()) == 20;
  };
  // Ids and sequence number, one parameter of 4 bytes, end of the list, payload of 4 bytes.
  const std::vector<std::uint8_t> data{0x15, 0x07, 40, 0, 0, 0, 16, 0, 0, 0,    0, 0, 0, 0, 0x0D,
                                       3,    0,    0,  0, 0, 5, 0,  0, 0, 0x70, 0, 4, 0, 1, 2,
                                       3,    4,    1,  0, 0, 0, 0,  1, 0, 0,    9, 9, 9, 9};
  CHECK_FALSE(filtered(data));
  std::vector<std::uint8_t> whole_datagram = data;
  whole_datagram[2] = 0;
  CHECK_FALSE(filtered(whole_datagram));
  std::vector<std::uint8_t> too_short = data;
  too_short[2] = 24;  // ends within the list
  CHECK(filtered(too_short));
  std::vector<std::uint8_t> long_parameter = data;
  long_parameter[27] = 0x40;
  CHECK(filtered(long_parameter));
  std::vector<std::uint8_t> far_away = data;
  far_away[6] = 200;
  CHECK(filtered(far_away));
  const std::vector<std::uint8_t> cut(data.begin(), data.begin() + 12);
  CHECK(filtered(cut));
}

TEST_CASE("a participant announces itself on the discovery multicast port of its domain", "[transport]") {
  const std::uint32_t domain = test_domain();
  // DDSI-RTPS 2.3, section 9.6.1.1: PB + DG * domain + d0.
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(7400 + 250 * domain));
  const int listener = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  REQUIRE(bind(listener, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0);
  ip_mreq group{};
  group.imr_multiaddr.s_addr = inet_addr("239.255.0.1");
  if (setsockopt(listener, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) != 0) {
    close(listener);
    WARN("skipped: no interface with multicast");
    return;
  }
  const timeval patience{.tv_sec = 5, .tv_usec = 0};
  setsockopt(listener, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  ParticipantConfig config;
  config.domain = domain;
  const auto participant = Participant::create(config);
  REQUIRE(participant.ok());
  std::array<char, 2048> datagram{};
  const ssize_t bytes = recv(listener, datagram.data(), datagram.size(), 0);
  close(listener);
  REQUIRE(bytes > 20);
  CHECK(std::string(datagram.data(), 4) == "RTPS");
}

TEST_CASE("a publisher ends with its parent process", "[transport]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  std::array<int, 2> pids{};
  REQUIRE(pipe2(pids.data(), O_CLOEXEC) == 0);
  const std::uint32_t domain = test_domain();
  const pid_t parent = fork();
  REQUIRE(parent >= 0);
  if (parent == 0) {
    auto process = PublisherProcess::create(process_config(*executable, domain));
    const auto pid = (*process)->start();
    const pid_t publisher = pid ? *pid : -1;
    if (write(pids[1], &publisher, sizeof publisher) != sizeof publisher) _exit(1);
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
    raise(SIGKILL);
  }
  pid_t publisher = -1;
  REQUIRE(read(pids[0], &publisher, sizeof publisher) == sizeof publisher);
  REQUIRE(publisher > 0);
  waitpid(parent, nullptr, 0);
  CHECK(eventually([publisher] {
    // Ended, or a zombie that waits for init.
    std::ifstream stat("/proc/" + std::to_string(publisher) + "/stat");
    std::string pid, name, state;
    return !(stat >> pid >> name >> state) || state == "Z";
  }));
  close(pids[0]);
  close(pids[1]);
}

TEST_CASE("a publisher without a ring fails with a message", "[transport]") {
  const auto executable = built_program("nilio-publisher");
  if (!executable) return;
  Program program(executable->string() + " --ring-fd=1 --wake-fd=1 --state-fd=1 2>&1");
  CHECK_THAT(program.line().value_or(""), Catch::Matchers::Contains("file descriptor 1 is not a ring"));
  CHECK(program.exit_status() == 1);
}
