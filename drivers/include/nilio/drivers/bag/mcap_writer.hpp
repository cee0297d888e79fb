#pragma once

#include "nilio/core/time.hpp"
#include "nilio/drivers/capture/record_file.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Writes ROS 2 messages as an MCAP file: zstd chunks with their message indexes, and at the end summary,
/// statistics and chunk index. Every chunk is appended as a whole, so that an unfinished file is readable up
/// to its last chunk. Memory: one chunk, what waits for the disk (RecordFile), and about 100 bytes for each
/// chunk. One thread.
class McapWriter {
 public:
  struct Channel {
    std::string topic;
    std::string type;         ///< "nav_msgs/msg/Odometry"
    std::string definition;   ///< message definition with its dependencies, ros2msg
    bool is_latched = false;  ///< transient local, for /tf_static
  };
  /// A chunk is closed at this size or age.
  static constexpr std::size_t kChunkBytes = std::size_t{1} << 20U;
  static constexpr std::int64_t kChunkNs = 1'000'000'000;

  McapWriter(std::filesystem::path path, std::vector<Channel> channels);
  McapWriter(const McapWriter&) = delete;
  McapWriter& operator=(const McapWriter&) = delete;
  ~McapWriter();

  /// Adds a message in CDR with its encapsulation; `stamp` is log and publish time.
  void add(std::size_t channel, core::Time stamp, std::span<const std::uint8_t> message);
  /// Closes a chunk that is old enough. `now_ns`: CLOCK_MONOTONIC.
  void close_old_chunk(std::int64_t now_ns);
  /// Closes the last chunk and appends summary and footer; no message may follow.
  void finish();
  /// To be written by the owner.
  [[nodiscard]] RecordFile& file() { return file_; }
  /// Messages of chunks that the disk did not accept in time.
  [[nodiscard]] std::uint64_t lost() const { return lost_; }

 private:
  struct ChunkIndex {
    std::int64_t first_ns = 0;
    std::int64_t last_ns = 0;
    std::uint64_t offset = 0;
    std::uint64_t length = 0;
    std::uint64_t packed_bytes = 0;
    std::uint64_t bytes = 0;
    /// Offset of each channel's message index behind the chunk, 0 = none; and their length in all.
    std::vector<std::uint32_t> index_offsets;
    std::uint64_t index_length = 0;
  };
  struct Entry {
    std::int64_t stamp_ns = 0;
    std::uint64_t offset = 0;
  };
  class Compressor;

  void close_chunk();

  std::vector<Channel> channels_;
  RecordFile file_;
  std::unique_ptr<Compressor> compressor_;
  std::vector<std::uint8_t> chunk_;
  std::vector<std::vector<Entry>> entries_;  ///< of the open chunk, by channel
  std::vector<std::uint32_t> sequences_;
  std::int64_t first_ns_ = 0;
  std::int64_t last_ns_ = 0;
  std::optional<std::int64_t> opened_ns_;
  std::vector<ChunkIndex> chunks_;
  std::vector<std::uint64_t> written_;  ///< messages by channel
  std::uint64_t lost_ = 0;
};

}  // namespace nilio::drivers
