#include "tests/fuzz/rtps/mutations.hpp"

#include <algorithm>
#include <array>
#include <iterator>

namespace nilio::fuzz {
namespace {

// DDSI-RTPS 2.3, sections 8.3.3 and 9.4.5: a header of 20 bytes, then submessages with kind, flags and
// length.
constexpr std::size_t kHeaderBytes = 20;
constexpr std::size_t kSubmessageHeaderBytes = 4;
constexpr std::size_t kMaxBytes = 65'000;
constexpr std::array<std::uint8_t, 14> kKinds{0x01, 0x06, 0x07, 0x08, 0x09, 0x0c, 0x0d,
                                              0x0e, 0x0f, 0x12, 0x13, 0x15, 0x16, 0x80};
constexpr std::array<std::uint8_t, 8> kBytes{0x00, 0x01, 0x03, 0x04, 0x7f, 0x80, 0xfe, 0xff};
constexpr std::array<std::uint32_t, 10> kWords{0,       1,          0x7f,        0x100,       0xffff,
                                               0x10000, 0x7fffffff, 0x80000000U, 0xfffffffeU, 0xffffffffU};

std::size_t length_of(const Datagram& datagram, std::size_t submessage) {
  const bool little_endian = (datagram[submessage + 1] & 1U) != 0;
  const std::size_t first = datagram[submessage + 2];
  const std::size_t second = datagram[submessage + 3];
  return little_endian ? first + 256 * second : 256 * first + second;
}

using Offset = Datagram::difference_type;

Datagram::iterator at(Datagram& datagram, std::size_t position) {
  return datagram.begin() + static_cast<Offset>(position);
}

}  // namespace

Datagram Mutator::next() {
  Datagram datagram = recording_[below(recording_.size())];
  for (std::size_t damages = 1 + below(4); damages > 0; --damages) damage(datagram);
  if (datagram.size() > kMaxBytes) datagram.resize(kMaxBytes);
  return datagram;
}

std::size_t Mutator::submessage(const Datagram& datagram) {
  std::vector<std::size_t> begins;
  std::size_t position = kHeaderBytes;
  while (position + kSubmessageHeaderBytes <= datagram.size()) {
    begins.push_back(position);
    const std::size_t length = length_of(datagram, position);
    if (length == 0) break;
    position += kSubmessageHeaderBytes + (length + 3) / 4 * 4;
  }
  return begins.empty() ? datagram.size() : begins[below(begins.size())];
}

void Mutator::damage(Datagram& datagram) {
  if (datagram.size() <= kHeaderBytes + kSubmessageHeaderBytes) return;
  const std::size_t position = below(datagram.size());
  const std::size_t body = kHeaderBytes + below(datagram.size() - kHeaderBytes);
  const std::size_t begin = submessage(datagram);
  switch (below(11)) {
    case 0:  // one bit
      datagram[body] ^= static_cast<std::uint8_t>(1U << below(8));
      return;
    case 1:  // one byte
      datagram[body] = kBytes[below(kBytes.size())];
      return;
    case 2: {  // an aligned number: lengths, counts, sequence numbers
      const std::uint32_t word = kWords[below(kWords.size())];
      const std::size_t aligned = std::min(body / 4 * 4, datagram.size() - 4);
      const bool swapped = below(4) == 0;
      for (std::size_t i = 0; i < 4; ++i)
        datagram[aligned + i] = static_cast<std::uint8_t>(word >> 8 * (swapped ? 3 - i : i));
      return;
    }
    case 3:  // any byte of the header or body at random
      datagram[position] = static_cast<std::uint8_t>(below(256));
      return;
    case 4:  // kind of a submessage
      if (begin < datagram.size()) datagram[begin] = kKinds[below(kKinds.size())];
      return;
    case 5:  // flags, with or without the byte order
      if (begin < datagram.size()) datagram[begin + 1] ^= static_cast<std::uint8_t>(1U << below(8));
      return;
    case 6: {  // length of a submessage, by a little or at all
      if (begin >= datagram.size()) return;
      const std::size_t length = length_of(datagram, begin);
      const std::size_t wrong = below(2) == 0 ? length + below(9) - 4 : below(65'536);
      const bool little_endian = (datagram[begin + 1] & 1U) != 0;
      datagram[begin + 2] = static_cast<std::uint8_t>(little_endian ? wrong : wrong >> 8U);
      datagram[begin + 3] = static_cast<std::uint8_t>(little_endian ? wrong >> 8U : wrong);
      return;
    }
    case 7:  // cut
      datagram.resize(position);
      return;
    case 8: {  // insert
      Datagram bytes(1 + below(64));
      for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(below(256));
      datagram.insert(at(datagram, body), bytes.begin(), bytes.end());
      return;
    }
    case 9: {  // remove
      const std::size_t count = std::min(datagram.size() - body, 1 + below(16));
      datagram.erase(at(datagram, body), at(datagram, body + count));
      return;
    }
    default: {  // submessages of another datagram instead of this one's, from here on
      const Datagram& other = recording_[below(recording_.size())];
      const std::size_t from = submessage(other);
      datagram.resize(std::min(begin, datagram.size()));
      std::copy(other.begin() + static_cast<Offset>(from), other.end(), std::back_inserter(datagram));
      return;
    }
  }
}

}  // namespace nilio::fuzz
