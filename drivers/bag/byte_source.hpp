#pragma once

#include "nilio/core/result.hpp"

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

}  // namespace nilio::drivers::bag
