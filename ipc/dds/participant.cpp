#include "ipc/dds/participant.hpp"

#include "ipc/dds/filtered_transport.hpp"
#include "ipc/dds/topic_conflicts.hpp"
#include "ipc/kernel_requests.hpp"

#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <chrono>
#include <cstring>
#include <ifaddrs.h>
#include <mutex>
#include <netinet/in.h>
#include <utility>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#include <fastrtps/xmlparser/XMLProfileManager.h>

namespace nilio::dds {
namespace {

namespace fastdds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

constexpr std::uint32_t kMaxDomain = 232;  // higher domains have port numbers beyond 16 bits
constexpr std::uint32_t kMaxMessageBytes = 65'500;
constexpr std::uint32_t kParticipantsPerPeer =
    32;  // as ROS 2; with the default of 4, further participants on a host are not found
constexpr std::size_t kMaxAddresses = 16;
constexpr std::uint32_t kInitialAnnouncements = 25;
const eprosima::fastrtps::Duration_t kInitialAnnouncementPeriod(0, 20'000'000);
// A participant that disappears without a word is forgotten after this time, whatever its readers requested.
const eprosima::fastrtps::Duration_t kParticipantLease(5, 0);
const eprosima::fastrtps::Duration_t kParticipantAnnouncements(1, 0);
constexpr std::array<char, 11> kEnclave{"enclave=/;"};
constexpr const char* kLoopback = "127.0.0.1";
constexpr const char* kDiscoveryMulticast = "239.255.0.1";

std::vector<std::string> local_ipv4_addresses() {
  std::vector<std::string> addresses;
  ifaddrs* interfaces = nullptr;
  if (getifaddrs(&interfaces) != 0) return addresses;
  for (const ifaddrs* interface = interfaces; interface != nullptr; interface = interface->ifa_next) {
    if (interface->ifa_addr == nullptr || interface->ifa_addr->sa_family != AF_INET) continue;
    sockaddr_in address{};
    std::memcpy(&address, interface->ifa_addr, sizeof address);
    std::array<char, INET_ADDRSTRLEN> text{};
    if (inet_ntop(AF_INET, &address.sin_addr, text.data(), text.size()) != nullptr)
      addresses.emplace_back(text.data());
  }
  freeifaddrs(interfaces);
  std::sort(addresses.begin(), addresses.end());
  return addresses;
}

bool contains(const std::vector<std::string>& list, const std::string& item) {
  return std::find(list.begin(), list.end(), item) != list.end();
}

std::string joined(const std::vector<std::string>& list) {
  std::string text;
  for (const std::string& item : list) text += (text.empty() ? "" : ", ") + item;
  return text.empty() ? "none" : text;
}

/// Port 0 stands for the unicast ports of the domain.
rtps::Locator_t peer(const char* address, std::uint32_t port) {
  rtps::Locator_t locator;
  rtps::IPLocator::setIPv4(locator, address);
  locator.port = port;
  return locator;
}

std::shared_ptr<FilteredTransportDescriptor> make_transport(const ParticipantConfig& config,
                                                            const std::vector<std::string>& whitelist) {
  const auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList = whitelist;
  udp->sendBufferSize = config.socket_buffer_bytes;
  udp->receiveBufferSize = config.socket_buffer_bytes;
  // With a full socket buffer a datagram is lost, which reliable readers request again; the writer does not
  // wait.
  udp->non_blocking_send = true;
  udp->maxMessageSize = kMaxMessageBytes;
  udp->maxInitialPeersRange = kParticipantsPerPeer;
  return std::make_shared<FilteredTransportDescriptor>(udp);
}

fastdds::DomainParticipantQos participant_qos(const ParticipantConfig& config,
                                              std::shared_ptr<FilteredTransportDescriptor> transport) {
  fastdds::DomainParticipantQos qos;
  qos.name(config.name);
  // Enclave of the node for ROS 2 tools; they read the topics without it, too.
  qos.user_data().data_vec({kEnclave.begin(), kEnclave.end()});

  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(std::move(transport));

  // Loopback usually has no multicast. Naming a peer disables the default multicast announcement, so that
  // address is named, too.
  auto& builtin = qos.wire_protocol().builtin;
  builtin.initialPeersList.push_back(peer(kLoopback, 0));
  const std::uint32_t discovery_port = qos.wire_protocol().port.getMulticastPort(config.domain);
  builtin.initialPeersList.push_back(peer(kDiscoveryMulticast, discovery_port));
  // The default of 4 would cut the addresses of a machine with container networks.
  qos.allocation().locators.max_unicast_locators = kMaxAddresses;
  // The first announcements are dropped by the closed transport.
  builtin.discovery_config.initial_announcements = {kInitialAnnouncements, kInitialAnnouncementPeriod};
  builtin.discovery_config.leaseDuration = kParticipantLease;
  builtin.discovery_config.leaseDuration_announcementperiod = kParticipantAnnouncements;
  builtin.readerHistoryMemoryPolicy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  builtin.writerHistoryMemoryPolicy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  return qos;
}

// Participants of one process exchange datagrams, too. When they call each other directly, Fast DDS 2.9's
// threads of two of them assert their liveliness at once and wait for each other for ever.
void disable_direct_delivery() {
  static std::once_flag once;
  std::call_once(once, [] {
    eprosima::fastrtps::LibrarySettingsAttributes settings;
    settings.intraprocess_delivery = eprosima::fastrtps::INTRAPROCESS_OFF;
    eprosima::fastrtps::xmlparser::XMLProfileManager::library_settings(settings);
  });
}

// Forwards at most kPerSecond lines per second.
class ThrottledConsumer : public fastdds::LogConsumer {
 public:
  explicit ThrottledConsumer(std::function<void(const std::string&)> handler)
      : handler_(std::move(handler)) {}

  void Consume(
      const fastdds::Log::Entry& entry) override {  // NOLINT(readability-identifier-naming): Fast DDS's name
    // Fast DDS starts this thread from the first thread that logs, which may be FIFO.
    if (!std::exchange(is_normal_, true)) ipc::leave_fifo();
    const auto now = std::chrono::steady_clock::now();
    if (now - window_start_ > std::chrono::seconds(1)) {
      if (suppressed_ > 0) handler_("Fast DDS: " + std::to_string(suppressed_) + " more messages not shown");
      window_start_ = now;
      passed_ = 0;
      suppressed_ = 0;
    }
    if (passed_ >= kPerSecond) {
      ++suppressed_;
      return;
    }
    ++passed_;
    handler_(std::string("Fast DDS ") + entry.context.category + ": " + entry.message);
  }

 private:
  static constexpr int kPerSecond = 10;

  std::function<void(const std::string&)> handler_;
  bool is_normal_ = false;
  std::chrono::steady_clock::time_point window_start_;
  int passed_ = 0;
  std::uint64_t suppressed_ = 0;
};

bool is_name_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
}

}  // namespace

core::Result<TopicNames> topic_names(const std::string& prefix) {
  std::string path = "rt/";
  for (const char c : prefix) {
    if (c == '/') {
      if (path.back() != '/') path += '/';
      continue;
    }
    const bool starts_with_digit = path.back() == '/' && c >= '0' && c <= '9';
    if (!is_name_character(c) || starts_with_digit)
      return core::Error{
          "topic prefix \"" + prefix +
          "\": use letters, digits and _, parts separated by / and none starting with a digit"};
    path += c;
  }
  if (path.back() != '/') path += '/';
  return TopicNames{path + "odom",
                    "rt/tf",
                    path + "nilio/latency",
                    path + "nilio/scan_report",
                    path + "nilio/odometry_imu",
                    path + "nilio/odometry_imu_status",
                    path + "registered_scan",
                    path + "path",
                    path + "submaps",
                    path + "submap_poses",
                    path + "local_map",
                    path + "nilio/map_corrections",
                    "rt/tf_static",
                    "rt/diagnostics"};
}

Participant::Participant() = default;

core::Result<std::unique_ptr<Participant>> Participant::create(const ParticipantConfig& config) {
  return create(config, nullptr);
}

core::Result<std::unique_ptr<Participant>> Participant::create(const ParticipantConfig& config,
                                                               std::unique_ptr<TopicConflicts> conflicts) {
  if (config.domain > kMaxDomain)
    return core::Error{"DDS domain " + std::to_string(config.domain) + " is out of range: use 0 to " +
                       std::to_string(kMaxDomain)};
  std::unique_ptr<Participant> result(new Participant);
  result->conflicts_ = std::move(conflicts);
  result->addresses_ = local_ipv4_addresses();
  for (const std::string& address : config.interface_whitelist) {
    in_addr parsed{};
    if (inet_pton(AF_INET, address.c_str(), &parsed) != 1)
      return core::Error{"DDS interface \"" + address +
                         "\" is not an IPv4 address: give the interface's own address, " + "one of " +
                         joined(result->addresses_)};
    (contains(result->addresses_, address) ? result->whitelist_ : result->missing_).push_back(address);
  }
  if (result->whitelist_.empty() && !result->missing_.empty())
    return core::Error{"none of the DDS interfaces " + joined(result->missing_) +
                       " is on this machine, which has " + joined(result->addresses_) +
                       ": correct the list, or wait until the network is up"};
  if (!result->whitelist_.empty() && !contains(result->whitelist_, kLoopback))
    result->whitelist_.emplace_back(kLoopback);

  disable_direct_delivery();
  const auto transport = make_transport(config, result->whitelist_);
  result->participant_ = fastdds::DomainParticipantFactory::get_instance()->create_participant(
      config.domain, participant_qos(config, transport), result->conflicts_.get(),
      fastdds::StatusMask::none());
  if (result->participant_ == nullptr)
    return core::Error{"cannot join DDS domain " + std::to_string(config.domain) +
                       ": no free UDP port or no usable interface (this machine has " +
                       joined(result->addresses_) + ")"};
  transport->open();
  return result;
}

Participant::~Participant() {
  if (participant_ == nullptr) return;
  participant_->set_listener(nullptr);
  participant_->delete_contained_entities();
  fastdds::DomainParticipantFactory::get_instance()->delete_participant(participant_);
}

std::vector<std::string> Participant::take_conflicts() {
  return conflicts_ ? conflicts_->take() : std::vector<std::string>();
}

Participant::Refresh Participant::refresh_interfaces() {
  std::vector<std::string> addresses = local_ipv4_addresses();
  if (addresses == addresses_) return Refresh::kUnchanged;
  addresses_ = std::move(addresses);
  const bool appeared = std::any_of(missing_.begin(), missing_.end(), [this](const std::string& address) {
    return contains(addresses_, address);
  });
  if (appeared) return Refresh::kNeedsRestart;
  participant_->set_qos(participant_->get_qos());  // rescans the interfaces
  return Refresh::kRescanned;
}

void set_fastdds_log_handler(std::function<void(const std::string& line)> handler) {
  fastdds::Log::ClearConsumers();
  fastdds::Log::RegisterConsumer(std::make_unique<ThrottledConsumer>(std::move(handler)));
}

}  // namespace nilio::dds
