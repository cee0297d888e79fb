#include "ipc/dds/cloud_subscriber.hpp"

#include "ipc/dds/readers.hpp"
#include "ipc/dds/types.hpp"

#include <mutex>
#include <utility>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;

/// Stores the newest message of a topic until it is taken.
template <class Message>
class Newest : public fastdds::DataReaderListener {
 public:
  void on_data_available(fastdds::DataReader* reader) override {
    Message message;
    fastdds::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      const std::lock_guard lock(mutex_);
      message_ = std::move(message);
      ++received_;
      message = {};
    }
  }

  std::optional<Message> take() {
    const std::lock_guard lock(mutex_);
    return std::exchange(message_, std::nullopt);
  }
  std::uint64_t received() const {
    const std::lock_guard lock(mutex_);
    return received_;
  }

 private:
  mutable std::mutex mutex_;
  std::optional<Message> message_;
  std::uint64_t received_ = 0;
};

}  // namespace

// The listeners are declared before the participant and therefore outlive it.
struct CloudSubscriber::Entities {
  Entities() = default;
  ~Entities() {
    for (fastdds::DataReader* reader : {scan_reader, path_reader}) {
      if (reader != nullptr) reader->set_listener(nullptr);
    }
  }
  Entities(const Entities&) = delete;
  Entities& operator=(const Entities&) = delete;

  Newest<PointCloud2> scan;
  Newest<Path> path;
  std::unique_ptr<Participant> participant;
  fastdds::DataReader* scan_reader = nullptr;
  fastdds::DataReader* path_reader = nullptr;
};

CloudSubscriber::CloudSubscriber(std::unique_ptr<Entities> entities) : entities_(std::move(entities)) {}
CloudSubscriber::~CloudSubscriber() = default;

core::Result<std::unique_ptr<CloudSubscriber>> CloudSubscriber::create(const CloudSubscriberConfig& config) {
  const auto names = topic_names(config.topic_prefix);
  if (!names) return names.error();
  auto participant = Participant::create(config.participant);
  if (!participant) return participant.error();
  auto entities = std::make_unique<Entities>();
  entities->participant = std::move(participant).value();
  fastdds::DomainParticipant& domain_participant = entities->participant->get();
  fastdds::Subscriber* const subscriber =
      domain_participant.create_subscriber(fastdds::SUBSCRIBER_QOS_DEFAULT);
  if (subscriber == nullptr) return core::Error{"Fast DDS cannot create a subscriber (out of memory?)"};
  entities->scan_reader = create_reader(domain_participant, *subscriber, names->registered_scan,
                                        new PointCloud2Type, entities->scan, {.reliable = false});
  entities->path_reader =
      create_reader(domain_participant, *subscriber, names->path, new PathType, entities->path, {});
  if (entities->scan_reader == nullptr || entities->path_reader == nullptr)
    return core::Error{"Fast DDS cannot create the readers for " + names->registered_scan + ", " +
                       names->path + " (out of memory or sockets?)"};
  return std::unique_ptr<CloudSubscriber>(new CloudSubscriber(std::move(entities)));
}

std::optional<PointCloud2> CloudSubscriber::take_scan() { return entities_->scan.take(); }
std::optional<Path> CloudSubscriber::take_path() { return entities_->path.take(); }
std::uint64_t CloudSubscriber::scans_received() const { return entities_->scan.received(); }

}  // namespace nilio::dds
