#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Serialization of the messages of a topic.
enum class BagEncoding : std::uint8_t {
  kRos1,   ///< packed, little-endian
  kCdr,    ///< CDR with its encapsulation header, as ROS 2 writes it
  kOther,  ///< JSON, Protobuf, ...: not decoded
};

/// Topic of a recording, or one of several connections or channels with the same name, type and encoding.
struct BagTopic {
  std::string name;
  /// "sensor_msgs/PointCloud2", for ROS 2 without "/msg".
  std::string type;
  BagEncoding encoding = BagEncoding::kOther;
  /// Of the message definition, ROS 1 only; empty if the recording does not give it.
  std::string md5;
};

/// One recorded message.
struct BagMessage {
  /// Index into BagReader::topics().
  std::size_t topic = 0;
  /// Time at which the recorder received it.
  core::Time stamp;
  /// Serialized message; valid until the next call of next().
  std::span<const std::uint8_t> data;
};

/// Messages of a recording in the order of their recording; sorted by receive time within a chunk. Holds one
/// chunk in memory. Damaged parts are skipped, and named in notes(). One thread.
class BagReader {
 public:
  /// False for topics whose messages are not wanted: they are not decoded, where the format allows.
  using Filter = std::function<bool(const BagTopic&)>;

  BagReader() = default;
  BagReader(const BagReader&) = delete;
  BagReader& operator=(const BagReader&) = delete;
  virtual ~BagReader() = default;

  /// Empty at the end.
  virtual std::optional<BagMessage> next() = 0;
  /// Grows while the recording is read.
  [[nodiscard]] virtual const std::vector<BagTopic>& topics() const = 0;
  /// Lines about what was skipped and why, at most kMaxNotes.
  [[nodiscard]] virtual const std::vector<std::string>& notes() const = 0;

  static constexpr std::size_t kMaxNotes = 20;
};

/// Limits that recordings respect; larger declared sizes are refused.
inline constexpr std::uint64_t kMaxBagChunk = std::uint64_t{256} << 20U;

/// Whether the path is a ROS bag: a rosbag1, db3 or MCAP file by its first bytes, or a folder with
/// metadata.yaml or such files.
bool is_bag(const std::string& path);

/// Files of a recording: the path itself, or those that metadata.yaml names or the folder holds. Paths of
/// metadata.yaml that leave the folder are refused. Compressed files are refused with the command that
/// unpacks them.
core::Result<std::vector<std::string>> bag_files(const std::string& path);

/// Opens one or more files (rosbag1 format 2.0 with none, bz2 and lz4; rosbag2 db3; MCAP with none, lz4 and
/// zstd), as bag_files() returns them. Several are parts of one recording, read in the order of their first
/// message. Unfinished and damaged files are read as far as possible. Errors name file, reason and remedy.
core::Result<std::unique_ptr<BagReader>> open_bag(const std::vector<std::string>& files,
                                                  BagReader::Filter filter = {});

}  // namespace nilio::drivers
