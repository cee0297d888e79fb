#pragma once

#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/read_all.hpp"

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
  contents.packets = read_all(**source, 3, &contents.state);
  contents.stats = (*source)->stats();
  contents.status = (*source)->status();
  return contents;
}

}  // namespace nilio::tests
