#include "ipc/dds/odometry_subscriber.hpp"

#include "nilio/core/clock.hpp"

#include "ipc/dds/readers.hpp"
#include "ipc/dds/types.hpp"

#include <chrono>
#include <condition_variable>
#include <deque>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

constexpr int kReaderDepth = 100;
constexpr std::size_t kMostKept = 1024;   // capacity for reports that have not been taken
constexpr std::size_t kMaxWriters = 256;  // limit of remembered writers

core::Time now() {
  const auto since_epoch = std::chrono::system_clock::now().time_since_epoch();
  return {std::chrono::duration_cast<std::chrono::nanoseconds>(since_epoch).count()};
}

class OdometryQueue : public fastdds::DataReaderListener {
 public:
  explicit OdometryQueue(std::size_t capacity) : capacity_(capacity) {}

  void on_data_available(fastdds::DataReader* reader) override {
    ReceivedOdometry sample;
    fastdds::SampleInfo info;
    while (reader->take_next_sample(&sample.message, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      sample.received = now();
      sample.received_ns = monotonic_ns();
      sample.written = {info.source_timestamp.to_ns()};
      push(sample, info.sample_identity);
    }
  }

  void on_subscription_matched(fastdds::DataReader*,
                               const fastdds::SubscriptionMatchedStatus& status) override {
    const std::lock_guard lock(mutex_);
    counts_.publishers = status.current_count;
  }

  std::optional<ReceivedOdometry> next(core::Duration timeout) {
    std::unique_lock lock(mutex_);
    if (!filled_.wait_for(lock, std::chrono::nanoseconds(timeout.ns), [this] { return !samples_.empty(); }))
      return std::nullopt;
    std::optional<ReceivedOdometry> sample(std::move(samples_.front()));
    samples_.pop_front();
    return sample;
  }

  SubscriberCounts counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
  }

 private:
  void push(const ReceivedOdometry& sample, const eprosima::fastrtps::rtps::SampleIdentity& identity) {
    const std::lock_guard lock(mutex_);
    ++counts_.received;
    count_lost(identity);
    if (samples_.size() >= capacity_) {
      ++counts_.queue_dropped;
      return;
    }
    samples_.push_back(sample);
    filled_.notify_one();
  }

  void count_lost(const eprosima::fastrtps::rtps::SampleIdentity& identity) {
    if (last_sequence_.size() >= kMaxWriters) last_sequence_.clear();
    const std::uint64_t sequence = identity.sequence_number().to64long();
    const auto [writer, is_new] = last_sequence_.try_emplace(identity.writer_guid(), sequence);
    if (is_new) {
      ++counts_.writers_seen;
    } else if (sequence > writer->second) {
      counts_.lost += sequence - writer->second - 1;
      writer->second = sequence;
    }
  }

  const std::size_t capacity_;
  mutable std::mutex mutex_;
  std::condition_variable filled_;
  std::deque<ReceivedOdometry> samples_;
  std::map<eprosima::fastrtps::rtps::GUID_t, std::uint64_t> last_sequence_;
  SubscriberCounts counts_;
};

/// Passes every waiting message of the reader to `keep`.
template <class Message, class Keep>
void take_all(fastdds::DataReader& reader, const Keep& keep) {
  Message message;
  fastdds::SampleInfo info;
  while (reader.take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
    if (info.valid_data) keep(message);
  }
}

/// Stores the last message of a topic.
template <class Message>
class Latest : public fastdds::DataReaderListener {
 public:
  void on_data_available(fastdds::DataReader* reader) override {
    take_all<Message>(*reader, [this](const Message& message) {
      const std::lock_guard lock(mutex_);
      message_ = message;
    });
  }

  std::optional<Message> get() const {
    const std::lock_guard lock(mutex_);
    return message_;
  }

 private:
  mutable std::mutex mutex_;
  std::optional<Message> message_;
};

/// Stores the messages of a topic until take().
template <class Message>
class Kept : public fastdds::DataReaderListener {
 public:
  void on_data_available(fastdds::DataReader* reader) override {
    take_all<Message>(*reader, [this](const Message& message) {
      const std::lock_guard lock(mutex_);
      if (messages_.size() >= kMostKept) messages_.erase(messages_.begin());
      messages_.push_back(message);
    });
  }

  std::vector<Message> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(messages_, {});
  }

 private:
  std::mutex mutex_;
  std::vector<Message> messages_;
};

}  // namespace

// The listeners are declared before the participant and therefore outlive it.
struct OdometrySubscriber::Entities {
  explicit Entities(std::size_t capacity) : queue(capacity) {}
  ~Entities() {
    for (fastdds::DataReader* reader :
         {odometry_reader, latency_reader, diagnostics_reader, scan_report_reader, imu_status_reader}) {
      if (reader != nullptr) reader->set_listener(nullptr);
    }
  }
  Entities(const Entities&) = delete;
  Entities& operator=(const Entities&) = delete;

  OdometryQueue queue;
  Latest<LatencyReport> report;
  Latest<DiagnosticArray> diagnostics;
  Kept<ScanReport> scan_reports;
  Kept<ImuPoseStatus> imu_statuses;
  std::unique_ptr<Participant> participant;
  fastdds::DataReader* odometry_reader = nullptr;
  fastdds::DataReader* latency_reader = nullptr;
  fastdds::DataReader* diagnostics_reader = nullptr;
  fastdds::DataReader* scan_report_reader = nullptr;
  fastdds::DataReader* imu_status_reader = nullptr;
};

OdometrySubscriber::OdometrySubscriber(std::unique_ptr<Entities> entities) : entities_(std::move(entities)) {}
OdometrySubscriber::~OdometrySubscriber() = default;

core::Result<std::unique_ptr<OdometrySubscriber>> OdometrySubscriber::create(
    const OdometrySubscriberConfig& config) {
  auto names = topic_names(config.topic_prefix);
  if (!names) return names.error();
  auto participant = Participant::create(config.participant);
  if (!participant) return participant.error();

  auto entities = std::make_unique<Entities>(config.queue_capacity);
  entities->participant = std::move(participant).value();
  fastdds::DomainParticipant& domain_participant = entities->participant->get();
  fastdds::Subscriber* const subscriber =
      domain_participant.create_subscriber(fastdds::SUBSCRIBER_QOS_DEFAULT);
  if (subscriber == nullptr) return core::Error{"Fast DDS cannot create a subscriber (out of memory?)"};
  const std::string& odometry = config.imu_rate ? names->imu_odometry : names->odometry;
  const auto create = [&](const std::string& topic, fastdds::TopicDataType* type,
                          fastdds::DataReaderListener& listener, bool reliable = true) {
    return create_reader(domain_participant, *subscriber, topic, type, listener,
                         {.depth = kReaderDepth, .reliable = reliable});
  };
  Entities& e = *entities;
  e.odometry_reader = create(odometry, new OdometryType, e.queue, !config.imu_rate);
  e.latency_reader = create(names->latency, new LatencyReportType, e.report);
  e.diagnostics_reader = create(names->diagnostics, new DiagnosticArrayType, e.diagnostics);
  e.scan_report_reader = create(names->scan_report, new ScanReportType, e.scan_reports);
  e.imu_status_reader = create(names->imu_status, new ImuPoseStatusType, e.imu_statuses);
  for (const fastdds::DataReader* reader : {e.odometry_reader, e.latency_reader, e.diagnostics_reader,
                                            e.scan_report_reader, e.imu_status_reader}) {
    if (reader == nullptr)
      return core::Error{"Fast DDS cannot create the readers for " + odometry + ", " + names->latency + ", " +
                         names->diagnostics + ", " + names->scan_report + ", " + names->imu_status +
                         " (out of memory or sockets?)"};
  }
  return std::unique_ptr<OdometrySubscriber>(new OdometrySubscriber(std::move(entities)));
}

std::optional<ReceivedOdometry> OdometrySubscriber::next(core::Duration timeout) {
  return entities_->queue.next(timeout);
}

std::optional<LatencyReport> OdometrySubscriber::latency_report() const { return entities_->report.get(); }

std::optional<DiagnosticArray> OdometrySubscriber::diagnostics() const {
  return entities_->diagnostics.get();
}

std::vector<ScanReport> OdometrySubscriber::scan_reports() { return entities_->scan_reports.take(); }

std::vector<ImuPoseStatus> OdometrySubscriber::imu_statuses() { return entities_->imu_statuses.take(); }

SubscriberCounts OdometrySubscriber::counts() const { return entities_->queue.counts(); }

}  // namespace nilio::dds
