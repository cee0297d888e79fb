#pragma once

#include "nilio/core/se3.hpp"

#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace nilio::mapping {

using Bytes = std::vector<std::uint8_t>;

static_assert(std::endian::native == std::endian::little, "map files are little endian");

/// Appends numbers to a buffer, little endian.
class ByteWriter {
 public:
  template <class T>
  void put(const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    const std::size_t at = bytes_.size();
    bytes_.resize(at + sizeof(T));
    std::memcpy(bytes_.data() + at, &value, sizeof(T));
  }
  void put_bytes(std::span<const std::uint8_t> bytes) {
    bytes_.insert(bytes_.end(), bytes.begin(), bytes.end());
  }
  /// Seven bits a byte, the least significant first.
  void put_varint(std::uint64_t value) {
    for (; value >= 0x80; value >>= 7U) bytes_.push_back(static_cast<std::uint8_t>(value | 0x80U));
    bytes_.push_back(static_cast<std::uint8_t>(value));
  }
  [[nodiscard]] const Bytes& bytes() const { return bytes_; }
  [[nodiscard]] Bytes take() { return std::move(bytes_); }

 private:
  Bytes bytes_;
};

/// Reads numbers from untrusted bytes. After a read beyond the end all values are 0 and failed() is true.
class ByteReader {
 public:
  explicit ByteReader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  template <class T>
  T get() {
    static_assert(std::is_arithmetic_v<T>);
    T value{};
    const std::span<const std::uint8_t> bytes = get_bytes(sizeof(T));
    if (!bytes.empty()) std::memcpy(&value, bytes.data(), sizeof(T));
    return value;
  }
  /// Empty if fewer are left.
  std::span<const std::uint8_t> get_bytes(std::size_t count) {
    if (failed_ || count > bytes_.size()) {
      failed_ = true;
      return {};
    }
    const std::span<const std::uint8_t> result = bytes_.first(count);
    bytes_ = bytes_.subspan(count);
    return result;
  }
  std::uint64_t get_varint() {
    std::uint64_t value = 0;
    for (unsigned shift = 0; shift < 64; shift += 7) {
      const auto byte = get<std::uint8_t>();
      value |= static_cast<std::uint64_t>(byte & 0x7FU) << shift;
      if ((byte & 0x80U) == 0) return value;
    }
    failed_ = true;
    return 0;
  }
  [[nodiscard]] std::size_t left() const { return bytes_.size(); }
  [[nodiscard]] bool failed() const { return failed_; }

 private:
  std::span<const std::uint8_t> bytes_;
  bool failed_ = false;
};

/// Translation, then the quaternion's x, y, z, w: 7 doubles.
inline void put_pose(const core::SE3& pose, ByteWriter& out) {
  for (int i = 0; i < 3; ++i) out.put(pose.translation[i]);
  for (int i = 0; i < 4; ++i) out.put(pose.rotation.coeffs()[i]);
}

/// As in the bytes; is_valid_pose() tells whether they were those of a pose.
inline core::SE3 get_pose(ByteReader& in) {
  core::SE3 pose;
  for (int i = 0; i < 3; ++i) pose.translation[i] = in.get<double>();
  for (int i = 0; i < 4; ++i) pose.rotation.coeffs()[i] = in.get<double>();
  return pose;
}

inline bool is_valid_pose(const core::SE3& pose) {
  return pose.is_finite() && std::abs(pose.rotation.norm() - 1.0) < 1e-3 && pose.translation.norm() < 1e9;
}

}  // namespace nilio::mapping
