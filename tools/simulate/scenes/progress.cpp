#include "tools/simulate/scenes/progress.hpp"

#include <cstdio>
#include <unistd.h>
#include <utility>

namespace nilio::tools::simulation {

Progress::Progress(std::string label, std::uint64_t total)
    : label_(std::move(label)), total_(total == 0 ? 1 : total), terminal_(::isatty(STDERR_FILENO) == 1) {}

void Progress::update(std::uint64_t done) {
  const std::uint64_t percent = 100 * done / total_;
  const std::uint64_t step = terminal_ ? 1 : 10;
  if (percent / step == shown_ / step) return;
  shown_ = percent;
  if (!terminal_) {
    std::fprintf(stderr, "%s: %3u %%\n", label_.c_str(), static_cast<unsigned>(percent / step * step));
    return;
  }
  constexpr std::uint64_t width = 40;
  const std::string bar(width * percent / 100, '#');
  std::fprintf(stderr, "\r%s [%-40s] %3u %%%s", label_.c_str(), bar.c_str(), static_cast<unsigned>(percent),
               percent == 100 ? "\n" : "");
}

}  // namespace nilio::tools::simulation
