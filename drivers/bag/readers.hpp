#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/bag/bag.hpp"

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace nilio::drivers::bag {

/// Random access to the bytes of a file, or of memory.
class ByteSource {
 public:
  ByteSource() = default;
  ByteSource(const ByteSource&) = delete;
  ByteSource& operator=(const ByteSource&) = delete;
  virtual ~ByteSource() = default;

  /// Bytes read from `offset`: fewer than asked for only at the end, or where the disk fails.
  virtual std::size_t read(std::uint64_t offset, std::span<std::uint8_t> bytes) = 0;
  [[nodiscard]] virtual std::uint64_t size() const = 0;
  [[nodiscard]] virtual const std::string& name() const = 0;

  /// Reads `count` bytes into `buffer`, which is resized to those that exist.
  bool read_all(std::uint64_t offset, std::uint64_t count, std::vector<std::uint8_t>& buffer);
};

core::Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);
std::unique_ptr<ByteSource> view_memory(std::span<const std::uint8_t> bytes, std::string name);

/// Readers of one file each; see open_bag(). Fail if the beginning is not that of their format.
core::Result<std::unique_ptr<BagReader>> open_rosbag1(std::unique_ptr<ByteSource> bytes,
                                                      BagReader::Filter filter);
core::Result<std::unique_ptr<BagReader>> open_mcap(std::unique_ptr<ByteSource> bytes,
                                                   BagReader::Filter filter);
core::Result<std::unique_ptr<BagReader>> open_db3(const std::string& path, BagReader::Filter filter);
/// A db3 in memory, which must outlive the reader; for tests and fuzzing.
core::Result<std::unique_ptr<BagReader>> open_db3(std::span<const std::uint8_t> bytes,
                                                  BagReader::Filter filter);

}  // namespace nilio::drivers::bag
