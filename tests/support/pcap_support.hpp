#pragma once

#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/drivers_support.hpp"

#include <array>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// Packets of a capture, and the state at its end.
struct CaptureContents {
  std::vector<drivers::Packet> packets;
  drivers::SourceState state = drivers::SourceState::kData;
  drivers::SourceStats stats;
  std::string status;
};

inline CaptureContents read_capture(const std::string& bytes, const drivers::PcapSourceConfig& config = {}) {
  const TemporaryFile file(bytes, ".pcap");
  auto source = drivers::open_pcap(file.path(), config);
  REQUIRE(source.ok());
  CaptureContents contents;
  std::array<drivers::Packet, 3> slots;
  for (;;) {
    const drivers::SourceRead result = (*source)->read(slots, core::Duration{});
    contents.state = result.state;
    if (result.state != drivers::SourceState::kData) break;
    contents.packets.insert(contents.packets.end(), slots.begin(),
                            slots.begin() + static_cast<std::ptrdiff_t>(result.count));
  }
  contents.stats = (*source)->stats();
  contents.status = (*source)->status();
  return contents;
}

}  // namespace nilio::tests
