#include "daemon/realtime/cpu_list.hpp"

#include <algorithm>
#include <charconv>
#include <optional>
#include <sched.h>

namespace nilio::daemon {

namespace {

using core::Error;
using core::Result;

std::optional<int> parse_number(std::string_view text) {
  int number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (error != std::errc{} || end != text.data() + text.size() || number < 0) return std::nullopt;
  return number;
}

Error wrong(std::string_view item, const std::string& what) {
  return Error{"'" + std::string(item) + "' " + what + ": expected numbers and ranges, such as 0 or 1-2,4"};
}

}  // namespace

Result<CpuList> parse_cpu_list(std::string_view text) {
  CpuList cpus;
  while (!text.empty()) {
    const std::string_view item = text.substr(0, text.find(','));
    const auto dash = item.find('-');
    const std::optional<int> first = parse_number(item.substr(0, dash));
    const std::optional<int> last =
        dash == std::string_view::npos ? first : parse_number(item.substr(dash + 1));
    if (!first || !last) return wrong(item, "is no processor");
    if (*last < *first) return wrong(item, "ends before it begins");
    if (*last >= CPU_SETSIZE) return wrong(item, "is beyond " + std::to_string(CPU_SETSIZE - 1));
    for (int cpu = *first; cpu <= *last; ++cpu) cpus.push_back(cpu);
    if (item.size() + 1 == text.size()) return wrong(text, "ends with a comma");
    text.remove_prefix(std::min(text.size(), item.size() + 1));
  }
  std::sort(cpus.begin(), cpus.end());
  cpus.erase(std::unique(cpus.begin(), cpus.end()), cpus.end());
  return cpus;
}

std::string cpu_list_text(const CpuList& cpus) {
  std::string text;
  for (std::size_t i = 0; i < cpus.size();) {
    std::size_t last = i;
    while (last + 1 < cpus.size() && cpus[last + 1] == cpus[last] + 1) ++last;
    text += (text.empty() ? "" : ",") + std::to_string(cpus[i]);
    if (last > i) text += "-" + std::to_string(cpus[last]);
    i = last + 1;
  }
  return text;
}

}  // namespace nilio::daemon
