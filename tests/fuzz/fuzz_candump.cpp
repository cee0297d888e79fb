// Input as a candump log, as its lines, and as a capture.

#include "nilio/drivers/can/can_files.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <string_view>

namespace nilio::fuzz {
namespace {

void check_line(std::string_view line) {
  const auto parsed = drivers::parse_candump_line(line);
  if (!parsed) return;
  const drivers::CanFrame& frame = parsed->frame;
  require(frame.length <= frame.data.size(), "frames fit their slots");
  const bool wide = frame.extended || frame.error;
  require(frame.id <= (wide ? 0x1FFFFFFFU : 0x7FFU), "identifiers have 11 or 29 bits");
  if (frame.stamp.ns < 0) return;
  const auto again = drivers::parse_candump_line(drivers::format_candump_line(frame, parsed->interface_name));
  require(again.has_value(), "a line that was read can be written");
  require(again->frame.id == frame.id && again->frame.stamp == frame.stamp &&
              again->frame.length == frame.length && again->frame.data == frame.data &&
              again->interface_name == parsed->interface_name,
          "a line that was written reads back the same");
}

void read_all(core::Result<std::unique_ptr<drivers::FrameSource>> source) {
  if (!source) return;
  static std::array<drivers::CanFrame, 5> slots;
  std::uint64_t delivered = 0;
  for (;;) {
    const drivers::SourceRead read = (*source)->read(slots, {});
    require(read.count <= slots.size(), "no more frames than slots");
    delivered += read.count;
    if (read.state != drivers::SourceState::kData) break;
  }
  require((*source)->stats().delivered == delivered, "every frame is counted once");
  require(!(*source)->status().empty(), "the status says something");
}

void read_file(std::span<const std::uint8_t> bytes) {
  const MemoryFile file(bytes);
  read_all(drivers::open_candump(file.path(), ""));
  read_all(drivers::open_candump(file.path(), "can1"));
  for (const char* interface_name : {"", "can0", "3"}) {
    read_all(drivers::open_can_capture(file.path(), interface_name));
  }
}

}  // namespace
}  // namespace nilio::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view rest(reinterpret_cast<const char*>(data), size);
  while (!rest.empty()) {
    const std::size_t length = std::min(rest.find('\n'), rest.size());
    nilio::fuzz::check_line(rest.substr(0, length));
    rest.remove_prefix(std::min(length + 1, rest.size()));
  }
  nilio::fuzz::read_file({data, size});
  return 0;
}
