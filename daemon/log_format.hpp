#pragma once

#include <array>
#include <cstddef>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <string>
#include <string_view>
#include <sys/stat.h>

#include <spdlog/formatter.h>
#include <spdlog/pattern_formatter.h>

namespace nilio {

/// The descriptor is a stream to the journal: JOURNAL_STREAM names its device and inode.
inline bool is_journal(int descriptor) {
  const char* const stream = std::getenv("JOURNAL_STREAM");
  struct stat status {};
  if (stream == nullptr || fstat(descriptor, &status) != 0) return false;
  return stream == std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino);
}

/// Priority of the journal: "<3>" for errors.
class JournalPriority : public spdlog::custom_flag_formatter {
 public:
  void format(const spdlog::details::log_msg& message, const std::tm& /*time*/,
              spdlog::memory_buf_t& line) override {
    // By spdlog's levels: trace, debug, info, warn, err, critical, off.
    constexpr std::string_view kPriorities = "7764322";
    const std::array<char, 3> prefix{'<', kPriorities[static_cast<std::size_t>(message.level)], '>'};
    line.append(prefix.data(), prefix.data() + prefix.size());
  }
  [[nodiscard]] std::unique_ptr<custom_flag_formatter> clone() const override {
    return std::make_unique<JournalPriority>();
  }
};

/// Format of a program's log lines. The journal adds time and program itself, and takes the priority.
inline std::unique_ptr<spdlog::formatter> log_formatter(const std::string& program, int descriptor) {
  auto formatter = std::make_unique<spdlog::pattern_formatter>();
  if (is_journal(descriptor)) {
    formatter->add_flag<JournalPriority>('*').set_pattern("%*%v");
  } else {
    formatter->set_pattern("%Y-%m-%d %H:%M:%S.%e " + program + " %l: %v");
  }
  return formatter;
}

}  // namespace nilio
