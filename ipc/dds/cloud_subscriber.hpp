#pragma once

#include "nilio/core/result.hpp"

#include "ipc/dds/participant.hpp"
#include "ipc/messages/messages.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

namespace nilio::dds {

struct CloudSubscriberConfig {
  ParticipantConfig participant;
  std::string topic_prefix;
};

/// Receives registered scans and the path, the newest of each. Scans are best effort: a reader that is late
/// costs the publisher no repair. The DDS threads only store; one thread takes. Numbers and text in a message
/// may have any value: they come from the network.
class CloudSubscriber {
 public:
  static core::Result<std::unique_ptr<CloudSubscriber>> create(const CloudSubscriberConfig& config);
  ~CloudSubscriber();
  CloudSubscriber(const CloudSubscriber&) = delete;
  CloudSubscriber& operator=(const CloudSubscriber&) = delete;

  /// The newest message since the last call, if any.
  std::optional<PointCloud2> take_scan();
  std::optional<Path> take_path();
  /// Scans since the start, those that were overwritten by newer ones included.
  [[nodiscard]] std::uint64_t scans_received() const;

 private:
  struct Entities;
  explicit CloudSubscriber(std::unique_ptr<Entities> entities);
  std::unique_ptr<Entities> entities_;
};

}  // namespace nilio::dds
