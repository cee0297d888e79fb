#include "tests/fuzz/rtps/participants.hpp"

#include "ipc/dds/filtered_transport.hpp"
#include "ipc/dds/imu_pose_publisher.hpp"
#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/dds/reports.hpp"
#include "ipc/dds/types.hpp"
#include "ipc/dds/writers.hpp"
#include "ipc/messages/diagnostics.hpp"

#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>
#include <string_view>
#include <sys/prctl.h>
#include <thread>
#include <unistd.h>
#include <unordered_set>
#include <utility>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/rtps/network/SenderResource.h>
#include <fastdds/rtps/transport/ChainingTransport.h>
#include <fastdds/rtps/transport/ChainingTransportDescriptor.h>
#include <fastdds/rtps/transport/TransportReceiverInterface.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

namespace nilio::fuzz {
namespace {

namespace fastdds = eprosima::fastdds::dds;
namespace transport = eprosima::fastdds::rtps;
namespace rtps = eprosima::fastrtps::rtps;

/// Different datagrams, in the order of their first occurrence.
class Recording {
 public:
  void add(const std::uint8_t* data, std::size_t bytes) {
    const std::string_view content(reinterpret_cast<const char*>(data), bytes);
    const std::lock_guard lock(mutex_);
    if (known_.size() < kMaxKept && known_.insert(std::hash<std::string_view>()(content)).second)
      datagrams_.emplace_back(data, data + bytes);
  }
  std::vector<Datagram> get() const {
    const std::lock_guard lock(mutex_);
    return datagrams_;
  }

 private:
  static constexpr std::size_t kMaxKept = 4000;
  mutable std::mutex mutex_;
  std::unordered_set<std::size_t> known_;  ///< hashes
  std::vector<Datagram> datagrams_;
};

class RecordingDescriptor : public transport::ChainingTransportDescriptor {
 public:
  RecordingDescriptor(std::shared_ptr<transport::TransportDescriptorInterface> low_level,
                      std::shared_ptr<Recording> recording)
      : ChainingTransportDescriptor(std::move(low_level)), recording_(std::move(recording)) {}
  transport::TransportInterface* create_transport() const override;
  [[nodiscard]] const std::shared_ptr<Recording>& recording() const { return recording_; }

 private:
  std::shared_ptr<Recording> recording_;
};

class RecordingTransport : public transport::ChainingTransport {
 public:
  explicit RecordingTransport(const RecordingDescriptor& descriptor)
      : ChainingTransport(descriptor), descriptor_(descriptor) {}
  transport::TransportDescriptorInterface* get_configuration() override { return &descriptor_; }
  bool send(rtps::SenderResource* sender, const rtps::octet* data, std::uint32_t bytes,
            rtps::LocatorsIterator* begin, rtps::LocatorsIterator* end,
            const std::chrono::steady_clock::time_point& timeout) override {
    descriptor_.recording()->add(data, bytes);
    return sender->send(data, bytes, begin, end, timeout);
  }
  void receive(transport::TransportReceiverInterface* receiver, const rtps::octet* data, std::uint32_t bytes,
               const rtps::Locator_t& local, const rtps::Locator_t& remote) override {
    const std::size_t harmless = dds::harmless_bytes(data, bytes);
    receiver->OnDataReceived(data, static_cast<std::uint32_t>(harmless), local, remote);
  }

 private:
  RecordingDescriptor descriptor_;
};

transport::TransportInterface* RecordingDescriptor::create_transport() const {
  return new RecordingTransport(*this);
}

template <class Message>
class CountingListener : public fastdds::DataReaderListener {
 public:
  explicit CountingListener(std::atomic<std::uint64_t>& count) : count_(count) {}
  void on_data_available(fastdds::DataReader* reader) override {
    Message message;
    fastdds::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) ++count_;
  }

 private:
  std::atomic<std::uint64_t>& count_;
};

}  // namespace

struct RecordingParticipant::Entities {
  std::shared_ptr<Recording> recording = std::make_shared<Recording>();
  std::atomic<std::uint64_t> received{0};
  std::vector<std::unique_ptr<fastdds::DataReaderListener>> listeners;
  fastdds::DomainParticipant* participant = nullptr;
  fastdds::Publisher* publisher = nullptr;
  fastdds::Subscriber* subscriber = nullptr;
  std::vector<fastdds::DataReader*> readers;
  std::vector<std::pair<fastdds::DataWriter*, std::function<void(fastdds::DataWriter*)>>> writers;

  template <class Message>
  void add(const std::string& topic, Message message, bool reliable = true) {
    fastdds::DataWriter* const writer =
        dds::create_writer<Message>(*participant, *publisher, topic, {.reliable = reliable, .user_data = ""});
    if (writer == nullptr) throw std::runtime_error("cannot create a writer of " + topic);
    writers.emplace_back(writer, [message](fastdds::DataWriter* out) mutable { out->write(&message); });
    fastdds::DataReaderQos qos;
    qos.reliability().kind =
        reliable ? fastdds::RELIABLE_RELIABILITY_QOS : fastdds::BEST_EFFORT_RELIABILITY_QOS;
    qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
    qos.data_sharing().off();
    listeners.push_back(std::make_unique<CountingListener<Message>>(received));
    readers.push_back(subscriber->create_datareader(participant->lookup_topicdescription(topic), qos,
                                                    listeners.back().get()));
    if (readers.back() == nullptr) throw std::runtime_error("cannot create a reader of " + topic);
  }
};

RecordingParticipant::RecordingParticipant(std::uint32_t domain) : entities_(std::make_unique<Entities>()) {
  Entities& e = *entities_;
  fastdds::DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  const auto udp = std::make_shared<transport::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.emplace_back("127.0.0.1");
  udp->maxInitialPeersRange = 4;
  qos.transport().user_transports.push_back(std::make_shared<RecordingDescriptor>(udp, e.recording));
  rtps::Locator_t peer;
  rtps::IPLocator::setIPv4(peer, "127.0.0.1");
  qos.wire_protocol().builtin.initialPeersList.push_back(peer);
  e.participant = fastdds::DomainParticipantFactory::get_instance()->create_participant(domain, qos);
  if (e.participant == nullptr) throw std::runtime_error("cannot join DDS domain " + std::to_string(domain));
  e.publisher = e.participant->create_publisher(fastdds::PUBLISHER_QOS_DEFAULT);
  e.subscriber = e.participant->create_subscriber(fastdds::SUBSCRIBER_QOS_DEFAULT);

  dds::Odometry odometry;
  odometry.frame_id = "odom";
  odometry.child_frame_id = "base_link";
  e.add("rt/odom", odometry);
  e.add("rt/nilio/odometry_imu", odometry, false);
  dds::TransformMessage transforms;
  transforms.transforms.resize(2);
  e.add("rt/tf", transforms);
  dds::LatencyReport latency;
  latency.stages.resize(12);
  for (dds::StageLatency& stage : latency.stages) {
    stage.name = "received_to_written";
    stage.buckets.resize(300);  // together more than one datagram holds
  }
  e.add("rt/nilio/latency", latency);
  dds::ScanReport report;
  report.state = "tracking";
  report.stages.resize(10);
  e.add("rt/nilio/scan_report", report);
  e.add("rt/nilio/odometry_imu_status", dds::ImuPoseStatus{});
  dds::DiagnosticArray diagnostics;
  diagnostics.statuses.resize(2);
  diagnostics.statuses.back().values.resize(8, {"gyro_scale", "57.3 1, bad"});
  e.add("rt/diagnostics", diagnostics);
}

RecordingParticipant::~RecordingParticipant() {
  for (fastdds::DataReader* reader : entities_->readers) reader->set_listener(nullptr);
  entities_->participant->delete_contained_entities();
  fastdds::DomainParticipantFactory::get_instance()->delete_participant(entities_->participant);
}

void RecordingParticipant::write() {
  for (auto& [writer, send] : entities_->writers) send(writer);
}

bool RecordingParticipant::is_matched() const {
  for (const auto& [writer, send] : entities_->writers) {
    const bool read_by_nilio = writer->get_topic()->get_name() != "rt/tf";
    if (read_by_nilio && dds::matched_subscribers(*writer) == 0) return false;
  }
  return received() > 0;
}

std::uint64_t RecordingParticipant::received() const { return entities_->received.load(); }

std::vector<Datagram> RecordingParticipant::recording() const { return entities_->recording->get(); }

void run_victim(std::uint32_t domain) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  dds::set_fastdds_log_handler([](const std::string&) {});
  dds::OdometryPublisherConfig config;
  config.participant.domain = domain;
  config.participant.interface_whitelist = {"127.0.0.1"};
  auto publisher = dds::OdometryPublisher::create(config);
  if (!publisher) std::exit(2);
  auto imu_poses = dds::ImuPosePublisher::create(**publisher, config);
  auto subscriber = dds::OdometrySubscriber::create({.participant = config.participant, .topic_prefix = ""});
  if (!imu_poses || !subscriber) std::exit(2);
  if (write(STDOUT_FILENO, "r", 1) != 1) std::exit(2);
  ipc::PoseRecord record;
  ipc::ImuPose imu_pose;
  dds::LatencyReport latency;
  while (true) {
    record.stamp_ns += 20'000'000;
    ++record.sequence;
    (*publisher)->publish_odometry(record);
    (*publisher)->publish_transform(record);
    (*publisher)->publish_scan_report(dds::make_scan_report(record, {}, {}, "host"));
    (*publisher)->publish_latency(latency);
    (*publisher)->publish_diagnostics(dds::make_diagnostics({record, {}}, {}));
    (*imu_poses)->publish(imu_pose);
    (*imu_poses)->publish_status({});
    (*publisher)->participant().take_conflicts();
    while ((*subscriber)->next(core::Duration{0})) {
    }
    (*subscriber)->scan_reports();
    (*subscriber)->imu_statuses();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

bool receives_pose(std::uint32_t domain, core::Duration patience) {
  dds::OdometrySubscriberConfig config;
  config.participant.domain = domain;
  config.participant.interface_whitelist = {"127.0.0.1"};
  const auto subscriber = dds::OdometrySubscriber::create(config);
  return subscriber.ok() && (*subscriber)->next(patience);
}

}  // namespace nilio::fuzz
