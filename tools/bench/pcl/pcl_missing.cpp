#include "tools/bench/odometry/pcl.hpp"

namespace nilio::tools {

core::Result<std::vector<Measurement>> measure_pcl(const BenchDataset& /*dataset*/,
                                                   const std::vector<std::string>& /*overrides*/) {
  return core::Error{
      "--vs pcl: this nilio was built without PCL: install libpcl-dev, run cmake again and rebuild"};
}

}  // namespace nilio::tools
