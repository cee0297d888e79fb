#pragma once

#include <string>
#include <vector>

namespace nilio::fuzz {

/// A small recording, as the bytes of its file.
struct BagSeed {
  std::string name;
  std::string bytes;
};

/// One message of every known type in each form of the readers, with every compression of the format.
std::vector<BagSeed> rosbag1_seeds();
std::vector<BagSeed> mcap_seeds();
std::vector<BagSeed> db3_seeds();

}  // namespace nilio::fuzz
