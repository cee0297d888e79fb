#pragma once

#include "nilio/drivers/bag/bag.hpp"

#include "drivers/bag/byte_source.hpp"

#include <memory>
#include <string>

namespace nilio::drivers::bag {

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
