#pragma once

#include <cstdint>
#include <string>

namespace nilio::tools::simulation {

/// Tells on standard error how far a long job is: a bar on a terminal, otherwise a line every tenth. One
/// thread.
class Progress {
 public:
  Progress(std::string label, std::uint64_t total);
  void update(std::uint64_t done);

 private:
  std::string label_;
  std::uint64_t total_;
  bool terminal_;
  std::uint64_t shown_ = 0;
};

}  // namespace nilio::tools::simulation
