#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

namespace nilio::drivers::bag {

enum class Compression : std::uint8_t { kNone, kBz2, kLz4, kZstd };

/// "none", "" (MCAP), "bz2", "lz4", "zstd".
std::optional<Compression> parse_compression(std::string_view name);

/// Unpacks one bz2 stream, LZ4 frame or zstd frame into `output`, which never grows beyond `size`. True if it
/// unpacked to exactly `size` bytes; otherwise `output` holds the bytes up to the damage or the cut. The
/// memory grows with the bytes that come out, not with `size`.
bool decompress(Compression compression, std::span<const std::uint8_t> input, std::uint64_t size,
                std::vector<std::uint8_t>& output);

/// Content size that a zstd frame states; empty without one.
std::optional<std::uint64_t> zstd_content_size(std::span<const std::uint8_t> frame);

/// Whether the bytes begin with the magic of a zstd frame.
bool is_zstd(std::span<const std::uint8_t> bytes);

}  // namespace nilio::drivers::bag
