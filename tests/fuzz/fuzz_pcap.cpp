// Input as a capture file, and as a frame of every link type.

#include "nilio/drivers/capture/capture_reader.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <array>

#include <pcap/dlt.h>

namespace nilio::fuzz {
namespace {

void check_frame(std::span<const std::uint8_t> frame) {
  constexpr std::array kLinkTypes{DLT_NULL,      DLT_EN10MB,     DLT_RAW, DLT_LOOP,
                                  DLT_LINUX_SLL, DLT_LINUX_SLL2, DLT_IPV4};
  for (const int link_type : kLinkTypes) {
    const drivers::CapturedDatagram datagram = drivers::find_datagram(link_type, frame);
    if (datagram.payload.empty()) continue;
    require(datagram.payload.data() >= frame.data(), "the payload begins inside the frame");
    require(datagram.payload.data() + datagram.payload.size() <= frame.data() + frame.size(),
            "the payload ends inside the frame");
  }
}

void read_capture(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  auto source = drivers::open_pcap(file.path(), {});
  if (!source) {
    require(source.error().message.find(file.path()) != std::string::npos, "errors name the file");
    return;
  }
  static std::array<drivers::Packet, 3> slots;
  std::uint64_t delivered = 0;
  for (;;) {
    const drivers::SourceRead read = (*source)->read(slots, {});
    if (read.state != drivers::SourceState::kData) {
      require(read.count == 0, "nothing comes with the end");
      require(read.state != drivers::SourceState::kIdle, "a file is never idle");
      break;
    }
    require(read.count > 0 && read.count <= slots.size(), "data comes with packets");
    for (const drivers::Packet& packet : std::span(slots).first(read.count)) {
      require(packet.size <= packet.data.size(), "packets fit their slots");
    }
    delivered += read.count;
  }
  require((*source)->stats().delivered == delivered, "every packet is counted once");
  require(!(*source)->status().empty(), "the status says something");
}

}  // namespace
}  // namespace nilio::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  nilio::fuzz::check_frame({data, size});
  nilio::fuzz::read_capture({data, size});
  return 0;
}
