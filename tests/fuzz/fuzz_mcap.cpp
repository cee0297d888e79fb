// Input as a MCAP file.

#include "drivers/bag/readers.hpp"
#include "tests/fuzz/fuzz_bag.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  auto reader = nilio::drivers::bag::open_mcap(nilio::drivers::bag::view_memory({data, size}, "fuzzed"), {});
  if (reader) nilio::fuzz::read_bag(**reader);
  return 0;
}
