// Input as the SQLite file of a ROS 2 bag.

#include "drivers/bag/readers.hpp"
#include "tests/fuzz/fuzz_bag.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  auto reader = nilio::drivers::bag::open_db3({data, size}, {});
  if (reader) nilio::fuzz::read_bag(**reader);
  return 0;
}
