#pragma once

#include <cstddef>
#include <cstdint>

namespace nilio::dds {

/// Number of bytes of an RTPS datagram before its first submessage that harms Fast DDS 2.9.1; all bytes if
/// there is none: statistics (0x80, vendor-specific), on which it aborts; data whose inline QoS is longer
/// than the submessage, which it copies as 4 GiB; heartbeats and gaps with sequence numbers that no writer
/// reaches, which it counts through one by one; fragments of samples beyond 16 MiB, which it allocates;
/// announcements of a participant (SPDP) in the name of another, which it never hears afterwards.
std::size_t harmless_bytes(const std::uint8_t* data, std::size_t bytes);

}  // namespace nilio::dds
