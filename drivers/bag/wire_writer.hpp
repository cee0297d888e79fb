#pragma once

#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

namespace nilio::drivers::bag {

/// Appends numbers and texts, packed and little-endian; the counterpart of WireReader.
class WireWriter {
 public:
  explicit WireWriter(std::vector<std::uint8_t>& out) : out_(out) {}

  template <class T>
  WireWriter& number(T value) {
    static_assert(std::is_arithmetic_v<T>);
    return append(&value, sizeof(T));
  }
  WireWriter& bytes(std::span<const std::uint8_t> value) { return append(value.data(), value.size()); }
  WireWriter& text(std::string_view value) {
    number(static_cast<std::uint32_t>(value.size()));
    return bytes({reinterpret_cast<const std::uint8_t*>(value.data()), value.size()});
  }

 private:
  // GCC 12 sees null pointers in an insert() of these.
  WireWriter& append(const void* from, std::size_t count) {
    const std::size_t size = out_.size();
    out_.resize(size + count);
    if (count > 0) std::memcpy(out_.data() + size, from, count);
    return *this;
  }

  std::vector<std::uint8_t>& out_;
};

}  // namespace nilio::drivers::bag
