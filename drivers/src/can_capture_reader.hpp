#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture_reader.hpp"

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// Where a captured frame came from.
struct CaptureInterface {
  /// Empty where the file has none.
  std::string_view name;
  bool big_endian_host = false;
};

/// Reads beside a pcapng reader and says for each packet block which interface it is of, and in which byte
/// order the machine wrote.
class PcapngInterfaces {
 public:
  explicit PcapngInterfaces(FileHandle file) : file_(std::move(file)) {}

  /// Of the next packet block, in the order of the file; without a name when there is nothing to tell.
  CaptureInterface next();

 private:
  [[nodiscard]] std::uint32_t number(const std::uint8_t* bytes, std::size_t size) const;
  bool read(std::uint8_t* bytes, std::size_t size);
  void add_interface(std::size_t body_size);

  FileHandle file_;
  bool big_endian_ = false;
  std::vector<std::string> names_;
};

/// Classic captures of any link type, through libpcap; fails as open_classic_capture().
core::Result<std::unique_ptr<CaptureReader>> open_any_classic_capture(FileHandle file);

}  // namespace nilio::drivers
