#pragma once

#include <cstdint>
#include <cstdio>
#include <string>
#include <unistd.h>
#include <utility>

namespace nilio::tools {

/// Shows the progress of a long job on standard error: a bar on a terminal, otherwise one line per 10 %. One
/// thread.
class Progress {
 public:
  Progress(std::string label, std::uint64_t total)
      : label_(std::move(label)), total_(total == 0 ? 1 : total), terminal_(::isatty(STDERR_FILENO) == 1) {}

  /// `done` of `total`.
  void update(std::uint64_t done) {
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

 private:
  std::string label_;
  std::uint64_t total_;
  bool terminal_;
  std::uint64_t shown_ = 0;
};

}  // namespace nilio::tools
