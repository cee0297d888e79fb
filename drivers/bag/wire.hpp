#pragma once

#include "nilio/core/time.hpp"
#include "nilio/core/units.hpp"
#include "nilio/drivers/bag/bag.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>

namespace nilio::drivers::bag {

/// Reads the fields of a serialized message or record in their order: packed little-endian (ROS 1 and the
/// records of bags), or CDR. A read beyond the end gives zeros and makes ok() false; lengths are checked
/// before use.
class WireReader {
 public:
  /// Packed, little-endian.
  explicit WireReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}
  /// A message; CDR begins with its encapsulation: plain CDR of version 1 or 2, either byte order.
  WireReader(std::span<const std::uint8_t> message, BagEncoding encoding) : bytes_(message) {
    if (encoding == BagEncoding::kRos1) return;
    const bool is_plain =
        message.size() >= 4 && message[0] == 0 && (message[1] <= 1 || message[1] == 6 || message[1] == 7);
    ok_ = encoding == BagEncoding::kCdr && is_plain;
    if (!ok_) return;
    swap_ = message[1] % 2 == 0;
    max_alignment_ = message[1] >= 6 ? 4 : 8;
    bytes_ = message.subspan(4);
  }

  template <class T>
  T number() {
    static_assert(std::is_arithmetic_v<T>);
    if (max_alignment_ > 1) {
      const std::size_t alignment = std::min(sizeof(T), max_alignment_);
      position_ = (position_ + alignment - 1) / alignment * alignment;
    }
    std::array<std::uint8_t, sizeof(T)> raw{};
    const std::span<const std::uint8_t> field = bytes(sizeof(T));
    std::copy(field.begin(), field.end(), raw.begin());
    if (swap_) std::reverse(raw.begin(), raw.end());
    T value{};
    std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }
  template <std::size_t N>
  std::array<double, N> doubles() {
    std::array<double, N> values{};
    for (double& value : values) value = number<double>();
    return values;
  }
  /// The next `count` bytes; empty and not ok() if there are fewer.
  std::span<const std::uint8_t> bytes(std::uint64_t count) {
    if (position_ > bytes_.size() || count > bytes_.size() - position_) {
      ok_ = false;
      position_ = bytes_.size();
      return {};
    }
    const auto result = bytes_.subspan(position_, static_cast<std::size_t>(count));
    position_ += static_cast<std::size_t>(count);
    return result;
  }
  /// Length of a sequence whose elements have at least `smallest` bytes each.
  std::uint32_t count(std::size_t smallest) {
    const auto length = number<std::uint32_t>();
    if (length > remaining() / smallest) ok_ = false;
    return ok_ ? length : 0;
  }
  /// Sequence of bytes.
  std::span<const std::uint8_t> blob() { return bytes(number<std::uint32_t>()); }
  /// Text without the terminating zero of CDR.
  std::string_view text() {
    const std::span<const std::uint8_t> raw = blob();
    std::string_view view(reinterpret_cast<const char*>(raw.data()), raw.size());
    if (max_alignment_ > 1 && view.ends_with('\0')) view.remove_suffix(1);
    return view;
  }
  /// Seconds and nanoseconds; not ok() for a number of nanoseconds that is none.
  core::Time time() {
    const auto seconds = number<std::uint32_t>();
    const auto nanoseconds = number<std::uint32_t>();
    if (nanoseconds >= 1'000'000'000U) ok_ = false;
    return {static_cast<std::int64_t>(seconds) * kNanosecondsPerSecond + nanoseconds};
  }
  [[nodiscard]] bool ok() const { return ok_; }
  [[nodiscard]] bool is_swapped() const { return swap_; }
  [[nodiscard]] std::size_t position() const { return position_; }
  [[nodiscard]] std::size_t remaining() const {
    return position_ < bytes_.size() ? bytes_.size() - position_ : 0;
  }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t position_ = 0;
  std::size_t max_alignment_ = 1;
  bool swap_ = false;
  bool ok_ = true;
};

}  // namespace nilio::drivers::bag
