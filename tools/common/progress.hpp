#pragma once

#include "nilio/core/clock.hpp"

#include <cstdint>
#include <cstdio>
#include <string>
#include <unistd.h>
#include <utility>

namespace nilio::tools {

/// Shows the progress of a long job as a bar on standard error if that is a terminal, and says nothing in a
/// pipe or a log. One thread at a time.
class Progress {
 public:
  /// `total` 0: unknown, the count is shown.
  explicit Progress(std::string label, std::uint64_t total = 0)
      : label_(std::move(label)), total_(total), terminal_(::isatty(STDERR_FILENO) == 1) {}
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;
  ~Progress() {
    if (shown_) std::fputc('\n', stderr);
  }

  /// `done` of `total`.
  void update(std::uint64_t done) {
    if (!terminal_) return;
    const std::int64_t now = monotonic_ns();
    const bool complete = total_ > 0 && done >= total_;
    if (now < next_ns_ && !complete) return;
    next_ns_ = now + kPeriodNs;
    shown_ = true;
    if (total_ == 0) {
      std::fprintf(stderr, "\r%s: %llu", label_.c_str(), static_cast<unsigned long long>(done));
      return;
    }
    const auto percent = static_cast<unsigned>(complete ? 100 : 100 * done / total_);
    constexpr unsigned width = 40;
    const std::string bar(width * percent / 100, '#');
    std::fprintf(stderr, "\r%s [%-40s] %3u %%", label_.c_str(), bar.c_str(), percent);
  }

 private:
  static constexpr std::int64_t kPeriodNs = 100'000'000;

  std::string label_;
  std::uint64_t total_;
  bool terminal_;
  bool shown_ = false;
  std::int64_t next_ns_ = monotonic_ns() + kPeriodNs;
};

}  // namespace nilio::tools
