#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/bag/bag.hpp"
#include "nilio/drivers/bag/messages.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {

/// A topic at the beginning of a recording.
struct BagTopicSurvey {
  BagTopic topic;
  BagContent content = BagContent::kOther;
  std::uint64_t messages = 0;
  core::Time first;  ///< receive times
  core::Time last;
  /// Frame of the first message, and smallest receive time minus stamp; both of messages with a header.
  std::string frame_id;
  std::optional<core::Duration> smallest_delay;

  /// Messages per second; 0 for fewer than two.
  [[nodiscard]] double rate_hz() const;
};

/// Topics at the beginning of a recording.
struct BagSurvey {
  std::vector<BagTopicSurvey> topics;
  std::vector<BagTransform> static_transforms;  ///< of /tf_static
  std::uint64_t bytes = 0;                      ///< of all messages
  bool is_complete = false;                     ///< the recording was read to its end
  std::vector<std::string> notes;               ///< see BagReader::notes()

  /// Topics whose messages have a content.
  [[nodiscard]] std::vector<const BagTopicSurvey*> with(BagContent content) const;
};

/// Reads up to `limit` of a recording, and at least one message of each topic that its index names.
core::Result<BagSurvey> survey_bag(const std::vector<std::string>& files,
                                   core::Duration limit = core::Duration::from_seconds(20.0));

/// T_parent_child along the tree of transforms, from frame to frame; empty if they are not connected.
std::optional<core::SE3> find_transform(const std::vector<BagTransform>& transforms,
                                        const std::string& parent, const std::string& child);

using SampleSource = Source<core::ImuSample>;

// Sources of one topic. Damaged messages are counted as malformed, and the end names what the recording
// lacks. Several topics of the same name are read together.
core::Result<std::unique_ptr<PacketSource>> open_bag_packets(const std::vector<std::string>& files,
                                                             const std::string& topic);
core::Result<std::unique_ptr<FrameSource>> open_bag_frames(const std::vector<std::string>& files,
                                                           const std::string& topic);
/// `shift` is added to the stamps. Accelerations in g, which Livox drivers publish, are told by their
/// magnitude and converted; status() says so.
core::Result<std::unique_ptr<SampleSource>> open_bag_imu(const std::vector<std::string>& files,
                                                         const std::string& topic, core::Duration shift = {});

/// Point clouds in their order: a topic of a bag, or a folder of files. One thread.
class CloudSource {
 public:
  CloudSource() = default;
  CloudSource(const CloudSource&) = delete;
  CloudSource& operator=(const CloudSource&) = delete;
  virtual ~CloudSource() = default;

  /// False at the end. The view is valid until the next call.
  virtual bool next(CloudView& cloud) = 0;
  [[nodiscard]] virtual std::uint64_t damaged() const = 0;
  /// Lines about skipped parts and their reasons.
  [[nodiscard]] virtual std::vector<std::string> notes() const = 0;
};
core::Result<std::unique_ptr<CloudSource>> open_bag_clouds(const std::vector<std::string>& files,
                                                           const std::string& topic);

}  // namespace nilio::drivers
