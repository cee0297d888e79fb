#pragma once

#include "nilio/drivers/bag/messages.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <initializer_list>
#include <optional>
#include <string_view>

namespace nilio::drivers::bag {

/// One column of a cloud.
class Column {
 public:
  Column() = default;
  Column(const CloudField& field, bool big_endian)
      : offset_(field.offset), type_(field.type), big_endian_(big_endian) {}

  /// Value of the point that begins at `point`.
  [[nodiscard]] double at(const std::uint8_t* point) const {
    const std::uint8_t* const from = point + offset_;
    switch (type_) {
      case 1:
        return get<std::int8_t>(from);
      case 2:
        return get<std::uint8_t>(from);
      case 3:
        return get<std::int16_t>(from);
      case 4:
        return get<std::uint16_t>(from);
      case 5:
        return get<std::int32_t>(from);
      case 6:
        return get<std::uint32_t>(from);
      case 7:
        return static_cast<double>(get<float>(from));
      case 8:
        return get<double>(from);
      default:
        return 0.0;
    }
  }
  [[nodiscard]] std::uint8_t type() const { return type_; }

 private:
  template <class T>
  [[nodiscard]] T get(const std::uint8_t* from) const {
    T value{};
    if (!big_endian_) {
      std::memcpy(&value, from, sizeof(T));
      return value;
    }
    std::array<std::uint8_t, sizeof(T)> raw{};
    std::reverse_copy(from, from + sizeof(T), raw.begin());
    std::memcpy(&value, raw.data(), sizeof(T));
    return value;
  }

  std::uint32_t offset_ = 0;
  std::uint8_t type_ = 0;
  bool big_endian_ = false;
};

/// The first of the names that is a field, whatever its case.
inline const CloudField* find_field(const CloudView& cloud, std::initializer_list<std::string_view> names) {
  const auto lower = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  for (const std::string_view name : names) {
    for (const CloudField& field : cloud.fields) {
      const bool equal = std::ranges::equal(field.name, name, {}, lower, lower);
      if (equal) return &field;
    }
  }
  return nullptr;
}

}  // namespace nilio::drivers::bag
