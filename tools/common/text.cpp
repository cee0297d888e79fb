#include "tools/common/text.hpp"

#include "nilio/core/units.hpp"

#include <array>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <ctime>

namespace nilio::tools {

std::string format(const char* pattern, ...) {
  va_list arguments;
  va_start(arguments, pattern);
  va_list again;
  va_copy(again, arguments);
  const int length = std::vsnprintf(nullptr, 0, pattern, arguments);
  va_end(arguments);
  std::string text(static_cast<std::size_t>(length > 0 ? length : 0) + 1, '\0');
  std::vsnprintf(text.data(), text.size(), pattern, again);
  va_end(again);
  text.pop_back();
  return text;
}

std::string stamp_text(core::Time stamp) {
  return format("%lld.%09lld", static_cast<long long>(stamp.ns / kNanosecondsPerSecond),
                static_cast<long long>(stamp.ns % kNanosecondsPerSecond));
}

std::string iso_text(core::Time stamp) {
  std::string text = utc_text(stamp) + "Z";
  text[10] = 'T';
  return text;
}

std::string utc_text(core::Time time) {
  const std::int64_t fraction_ns =
      (time.ns % kNanosecondsPerSecond + kNanosecondsPerSecond) % kNanosecondsPerSecond;
  const auto seconds = static_cast<std::time_t>((time.ns - fraction_ns) / kNanosecondsPerSecond);
  std::tm fields{};
  gmtime_r(&seconds, &fields);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%d %H:%M:%S", &fields);
  return format("%s.%03d", text.data(), static_cast<int>(fraction_ns / 1'000'000));
}

std::string printable_text(std::string_view text) {
  std::string result(text);
  for (char& c : result) {
    if (c < ' ' || c > '~') c = '?';
  }
  return result;
}

std::string without_trailing_space(std::string line) {
  line.erase(line.find_last_not_of(' ') + 1);
  return line + "\n";
}

std::string span_text(double seconds) {
  const double size = std::abs(seconds);
  if (size < 1e-3) return format("%.0f us", seconds * 1e6);
  if (size < 1.0) return format("%.1f ms", seconds * 1e3);
  if (size < 600.0) return format("%.3f s", seconds);
  if (size < 2 * 3600.0) return format("%.1f min", seconds / 60.0);
  if (size < 2 * 86400.0) return format("%.1f h", seconds / 3600.0);
  return format("%.1f days", seconds / 86400.0);
}

}  // namespace nilio::tools
