#pragma once

#include "nilio/drivers/bag/bag.hpp"

#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace nilio::drivers::bag {

/// Topics and notes of a reader.
class TopicTable {
 public:
  explicit TopicTable(BagReader::Filter filter) : filter_(std::move(filter)) {}

  /// Index of the topic, which is added if it is new; empty if there are too many. The filter is asked once.
  std::optional<std::size_t> add(BagTopic topic) {
    for (std::size_t i = 0; i < topics_.size(); ++i) {
      const BagTopic& other = topics_[i];
      if (other.name == topic.name && other.type == topic.type && other.encoding == topic.encoding &&
          other.md5 == topic.md5)
        return i;
    }
    if (topics_.size() >= kMaxTopics) return std::nullopt;
    wanted_.push_back(!filter_ || filter_(topic));
    topics_.push_back(std::move(topic));
    return topics_.size() - 1;
  }
  [[nodiscard]] bool is_wanted(std::size_t topic) const { return wanted_[topic]; }
  void note(const std::string& text) {
    if (notes_.size() < BagReader::kMaxNotes) notes_.push_back(text);
  }
  [[nodiscard]] const std::vector<BagTopic>& topics() const { return topics_; }
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  static constexpr std::size_t kMaxTopics = 4096;
  BagReader::Filter filter_;
  std::vector<BagTopic> topics_;
  std::vector<bool> wanted_;
  std::vector<std::string> notes_;
};

/// Messages of the current chunk, in the order of their stamps.
class ChunkQueue {
 public:
  void clear() {
    messages_.clear();
    next_ = 0;
  }
  void add(BagMessage message) { messages_.push_back(message); }
  void sort() {
    std::stable_sort(messages_.begin(), messages_.end(),
                     [](const BagMessage& a, const BagMessage& b) { return a.stamp < b.stamp; });
  }
  /// Empty when all were taken.
  std::optional<BagMessage> take() {
    if (next_ == messages_.size()) return std::nullopt;
    return messages_[next_++];
  }

 private:
  std::vector<BagMessage> messages_;
  std::size_t next_ = 0;
};

/// A stamp of a recording in the range of ROS 1 times, 1970 to 2106: sums and differences cannot overflow.
inline core::Time limit_stamp(std::int64_t ns) {
  constexpr std::int64_t kLatestNs = 4'294'967'295'999'999'999;
  return {std::clamp<std::int64_t>(ns, 0, kLatestNs)};
}

/// "sensor_msgs/msg/PointCloud2" as "sensor_msgs/PointCloud2".
inline std::string plain_type(std::string_view type) {
  std::string result(type);
  if (const std::size_t at = result.find("/msg/"); at != std::string::npos) result.erase(at, 4);
  return result;
}

}  // namespace nilio::drivers::bag
