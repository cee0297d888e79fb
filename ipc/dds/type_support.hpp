#pragma once

#include "nilio/core/units.hpp"

#include "ipc/dds/types.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/rtps/common/SerializedPayload.h>

/// Implementation of MessageType for the files that instantiate it. They define put(Out&, const Message&),
/// get(Input&, Message&), make_typical(Message&) and kRosType<Message> in the namespace of the messages,
/// where argument-dependent lookup finds them.
namespace nilio::dds {

using eprosima::fastcdr::Cdr;

inline constexpr std::size_t kEncapsulationBytes = 4;
/// Typical length of a name, for the preallocation of payloads; longer ones cost one reallocation.
inline constexpr std::size_t kTypicalName = 64;

// Counts the bytes that the same calls on a Cdr would write, including alignment.
class SizeCounter {
 public:
  SizeCounter& operator<<(bool) { return add(1, 1); }
  SizeCounter& operator<<(std::uint8_t) { return add(1, 1); }
  SizeCounter& operator<<(std::int32_t) { return add(4, 4); }
  SizeCounter& operator<<(std::uint32_t) { return add(4, 4); }
  SizeCounter& operator<<(std::int64_t) { return add(8, 8); }
  SizeCounter& operator<<(std::uint64_t) { return add(8, 8); }
  SizeCounter& operator<<(float) { return add(4, 4); }
  SizeCounter& operator<<(double) { return add(8, 8); }
  SizeCounter& operator<<(const std::string& text) { return add(4, 4).add(1, text.size() + 1); }
  template <std::size_t N>
  SizeCounter& operator<<(const std::array<double, N>&) {
    return add(8, 8 * N);
  }
  SizeCounter& operator<<(const std::vector<std::uint8_t>& bytes) { return add(4, 4).add(1, bytes.size()); }
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  SizeCounter& add(std::size_t alignment, std::size_t size) {
    bytes_ = (bytes_ + alignment - 1) / alignment * alignment + size;
    return *this;
  }
  std::size_t bytes_ = 0;
};

template <class Out>
void put(Out& out, core::Time time) {
  const std::int64_t nanoseconds =
      ((time.ns % kNanosecondsPerSecond) + kNanosecondsPerSecond) % kNanosecondsPerSecond;
  out << static_cast<std::int32_t>((time.ns - nanoseconds) / kNanosecondsPerSecond)
      << static_cast<std::uint32_t>(nanoseconds);
}

// Input of a payload: the Cdr, and the maximum number of bytes of a sequence.
struct Input {
  Cdr& cdr;
  std::size_t payload_bytes;
};

inline void get(Input& in, core::Time& time) {
  std::int32_t seconds = 0;
  std::uint32_t nanoseconds = 0;
  in.cdr >> seconds >> nanoseconds;
  time.ns = static_cast<std::int64_t>(seconds) * kNanosecondsPerSecond + nanoseconds;
}

// Reads a sequence length; throws if the elements cannot fit into the rest of the payload.
inline std::uint32_t get_length(Input& in, std::size_t smallest_element) {
  std::uint32_t length = 0;
  in.cdr >> length;
  const std::size_t left = in.payload_bytes - std::min(in.payload_bytes, in.cdr.getSerializedDataLength());
  if (length > left / smallest_element) throw std::length_error("sequence longer than its payload");
  return length;
}

template <class Message>
std::uint32_t serialized_bytes(const Message& message) {
  SizeCounter counter;
  put(counter, message);
  return static_cast<std::uint32_t>(kEncapsulationBytes + counter.bytes());
}

struct RosType {
  const char* name;
  std::string_view hash;
};
/// Name in DDS, and hash of ipc/idl/nilio.idl; tests/support/type_hashes.py computes it.
template <class Message>
constexpr RosType kRosType{};

template <class Message>
MessageType<Message>::MessageType() {
  Message typical;
  make_typical(typical);
  setName(kRosType<Message>.name);
  m_typeSize = serialized_bytes(typical);
  m_isGetKeyDefined = false;
  auto_fill_type_information(false);
  auto_fill_type_object(false);
}

template <class Message>
std::string_view MessageType<Message>::type_hash() {
  return kRosType<Message>.hash;
}

template <class Message>
bool MessageType<Message>::serialize(void* data, Payload* payload) {
  try {
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->max_size);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    payload->encapsulation = cdr.endianness() == Cdr::BIG_ENDIANNESS ? CDR_BE : CDR_LE;
    cdr.serialize_encapsulation();
    put(cdr, *static_cast<const Message*>(data));
    payload->length = static_cast<std::uint32_t>(cdr.getSerializedDataLength());
    return true;
  } catch (const std::exception&) {
    return false;  // larger than the payload: Fast DDS reports the failed write
  }
}

template <class Message>
bool MessageType<Message>::deserialize(Payload* payload, void* data) {
  try {
    if (payload->length < kEncapsulationBytes || payload->data[0] != 0 || payload->data[1] > 1) return false;
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.read_encapsulation();
    payload->encapsulation = cdr.endianness() == Cdr::BIG_ENDIANNESS ? CDR_BE : CDR_LE;
    Input in{cdr, payload->length};
    get(in, *static_cast<Message*>(data));
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

template <class Message>
std::function<std::uint32_t()> MessageType<Message>::getSerializedSizeProvider(void* data) {
  return [data] { return serialized_bytes(*static_cast<const Message*>(data)); };
}

}  // namespace nilio::dds
