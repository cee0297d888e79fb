#include "nilio/core/clock.hpp"
#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/capture_reader.hpp"

#include "drivers/can/log/log_lines.hpp"
#include "drivers/common/counters.hpp"

#include <array>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <memory>
#include <mutex>
#include <optional>
#include <sys/stat.h>

namespace nilio::drivers {
namespace {

using core::Error;

constexpr std::size_t kQuotedLength = 60;
/// A CAN FD frame of 64 bytes needs about 300 characters; a longer line is no frame.
constexpr std::size_t kLongestLine = 512;
/// Upper limit of one time difference, so that sums stay within 64 bits.
constexpr std::int64_t kLongestStepNs = 86'400'000'000'000;
constexpr std::int64_t kLatestNs = 4'000'000'000'000'000'000;
/// Lines read ahead: differences do not rise by chance over so many lines.
constexpr int kLinesReadAhead = 1000;

class CandumpSource final : public FrameSource {
 public:
  CandumpSource(FileHandle file, std::string path, std::string interface_name)
      : file_(std::move(file)), path_(std::move(path)), interface_name_(std::move(interface_name)) {
    detect_format();
  }

  SourceRead read(std::span<CanFrame> slots, core::Duration timeout) override;
  [[nodiscard]] SourceStats stats() const override { return counters_.read(); }
  [[nodiscard]] std::string status() const override;

 private:
  void detect_format();
  std::optional<std::string_view> next_line();
  bool accept_line(std::string_view line, CanFrame& slot);
  AscLog::Kind parse_line(std::string_view line, CandumpLine& parsed);
  AscLog::Kind parse_text_line(std::string_view line, CandumpLine& parsed);
  void note_broken(std::string_view line);

  FileHandle file_;
  const std::string path_;
  const std::string interface_name_;
  std::optional<AscLog> asc_;
  /// Relative times count from the previous line (candump -td).
  bool times_are_steps_ = false;
  core::Time last_stamp_;
  SourceCounters counters_;
  std::atomic<std::uint64_t> untimed_{0};
  std::atomic<std::uint64_t> line_number_{0};
  std::atomic<bool> ended_{false};
  std::atomic<int> read_error_{0};
  std::array<char, kLongestLine> line_{};
  mutable std::mutex names_mutex_;
  std::string first_broken_;
  std::string other_interface_;
};

SourceRead CandumpSource::read(std::span<CanFrame> slots, core::Duration /*timeout*/) {
  std::size_t count = 0;
  while (count < slots.size()) {
    const std::optional<std::string_view> line = next_line();
    if (!line) break;
    if (accept_line(*line, slots[count])) ++count;
  }
  if (count > 0 || slots.empty()) {
    counters_.add_delivered(count);
    return {SourceState::kData, count};
  }
  return {read_error_.load(std::memory_order_relaxed) != 0 ? SourceState::kFailed : SourceState::kEnd, 0};
}

/// Reads the next line; a line longer than any frame's is cut.
std::optional<std::string_view> CandumpSource::next_line() {
  errno = 0;
  if (std::fgets(line_.data(), static_cast<int>(line_.size()), file_.get()) == nullptr) {
    if (std::ferror(file_.get()) != 0) read_error_.store(errno, std::memory_order_relaxed);
    ended_.store(true, std::memory_order_relaxed);
    return std::nullopt;
  }
  line_number_.fetch_add(1, std::memory_order_relaxed);
  const std::string_view line(line_.data());
  if (line.size() + 1 == line_.size() && line.back() != '\n') {
    for (int c = std::fgetc(file_.get()); c != '\n' && c != EOF;) c = std::fgetc(file_.get());
  }
  return line;
}

/// Detects the format, and whether relative times are differences: those ever fall, times since the first
/// line do not.
void CandumpSource::detect_format() {
  // A pipe cannot be read twice: candump -L is assumed.
  if (std::fseek(file_.get(), 0, SEEK_CUR) != 0) return;
  core::Time last;
  for (int i = 0; i < kLinesReadAhead; ++i) {
    const std::optional<std::string_view> line = next_line();
    if (!line) break;
    if (i == 0 && AscLog::is_first_line(*line)) {
      asc_.emplace();
      break;
    }
    const std::optional<CandumpTextLine> text = parse_candump_text_line(*line);
    if (!text || text->clock != CandumpClock::kRelative) continue;
    times_are_steps_ = times_are_steps_ || text->line.frame.stamp < last;
    last = text->line.frame.stamp;
  }
  std::rewind(file_.get());
  line_number_.store(0, std::memory_order_relaxed);
  ended_.store(false, std::memory_order_relaxed);
  read_error_.store(0, std::memory_order_relaxed);
}

AscLog::Kind CandumpSource::parse_line(std::string_view line, CandumpLine& parsed) {
  if (asc_) return asc_->read(line, parsed);
  // Terminal output is indented and has the length in brackets.
  if (line.starts_with(' ')) return parse_text_line(line, parsed);
  if (!line.starts_with('(')) return AscLog::Kind::kOther;
  std::optional<CandumpLine> log_line = parse_candump_line(line);
  if (!log_line) return AscLog::Kind::kBroken;
  parsed = std::move(*log_line);
  return AscLog::Kind::kFrame;
}

AscLog::Kind CandumpSource::parse_text_line(std::string_view line, CandumpLine& parsed) {
  if (line.find('[') == std::string_view::npos) return AscLog::Kind::kOther;
  std::optional<CandumpTextLine> text = parse_candump_text_line(line);
  if (!text) return AscLog::Kind::kBroken;
  parsed = std::move(text->line);
  core::Time& stamp = parsed.frame.stamp;
  if (text->clock == CandumpClock::kNone) {
    untimed_.fetch_add(1, std::memory_order_relaxed);
    stamp = last_stamp_;
  } else if (text->clock == CandumpClock::kRelative && times_are_steps_) {
    stamp.ns = last_stamp_.ns + std::min(stamp.ns, kLongestStepNs);
    if (stamp.ns > kLatestNs) return AscLog::Kind::kBroken;
  }
  last_stamp_ = stamp;
  return AscLog::Kind::kFrame;
}

bool CandumpSource::accept_line(std::string_view line, CanFrame& slot) {
  CandumpLine parsed;
  const AscLog::Kind kind = parse_line(line, parsed);
  if (kind == AscLog::Kind::kOther) return false;
  if (kind == AscLog::Kind::kBroken) {
    if (counters_.read().malformed == 0) note_broken(line);
    counters_.add_malformed(1);
    return false;
  }
  if (!interface_name_.empty() && parsed.interface_name != interface_name_) {
    if (counters_.read().other == 0) {
      const std::lock_guard lock(names_mutex_);
      other_interface_ = parsed.interface_name;
    }
    counters_.add_other(1);
    return false;
  }
  slot = parsed.frame;
  slot.received_ns = monotonic_ns();
  return true;
}

void CandumpSource::note_broken(std::string_view line) {
  std::string text;
  for (const char c : line.substr(0, kQuotedLength)) {
    if (c == '\n' || c == '\r') break;
    text.push_back(c >= ' ' && c < '\x7F' ? c : '?');
  }
  const std::lock_guard lock(names_mutex_);
  first_broken_ = "line " + std::to_string(line_number_.load(std::memory_order_relaxed)) + ": '" + text + "'";
}

std::string CandumpSource::status() const {
  const SourceStats stats = counters_.read();
  std::string text = path_ + ": " + std::to_string(stats.delivered) + " frames";
  const std::lock_guard lock(names_mutex_);
  if (stats.malformed > 0)
    text += ", " + std::to_string(stats.malformed) + " broken lines, first " + first_broken_;
  if (stats.other > 0) {
    text +=
        ", " + std::to_string(stats.other) + " frames of other interfaces (first " + other_interface_ + ")";
  }
  if (const auto untimed = untimed_.load(std::memory_order_relaxed); untimed > 0) {
    text += ", " + std::to_string(untimed) +
            " frames without a time, which IMU samples need: record with candump -L";
  }
  if (const int error = read_error_.load(std::memory_order_relaxed); error != 0) {
    return text + "; reading failed: " + std::strerror(error);
  }
  if (!ended_.load(std::memory_order_relaxed) || stats.delivered > 0) return text;
  if (stats.other > 0)
    return text + "; no frame is of interface '" + interface_name_ + "', set it to one that is there";
  return text + "; expected lines as candump -L writes them: (1700000000.123456) can0 034#0000000009CF";
}

}  // namespace

core::Result<std::unique_ptr<FrameSource>> open_candump(const std::string& path,
                                                        const std::string& interface_name) {
  FileHandle file(std::fopen(path.c_str(), "re"));
  if (!file)
    return Error{path + ": cannot be opened (" + std::strerror(errno) +
                 "); check the path and its permissions"};
  struct stat info {};
  if (fstat(fileno(file.get()), &info) == 0 && S_ISDIR(info.st_mode)) {
    return Error{path + ": is a folder; give a candump log (candump -l writes them)"};
  }
  return std::unique_ptr<FrameSource>(std::make_unique<CandumpSource>(std::move(file), path, interface_name));
}

}  // namespace nilio::drivers
