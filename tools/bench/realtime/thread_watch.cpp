#include "tools/bench/realtime/thread_watch.hpp"

#include "tools/common/child_process.hpp"
#include "tools/common/files.hpp"

#include <nlohmann/json.hpp>

namespace nilio::tools::bench {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;
using nlohmann::json;

constexpr const char* kLibrary = "libnilio-watch.so";
constexpr const char* kReport = "watch.json";

NamedCounts counts_in(const json& counts) {
  NamedCounts result;
  for (const auto& [name, value] : counts.items()) result.emplace_back(name, value.get<std::uint64_t>());
  return result;
}

ThreadWatch parse(const json& report) {
  ThreadWatch watch;
  watch.watched_s = report.at("watched_ns").get<double>() * 1e-9;
  watch.workers = report.at("workers").get<std::uint64_t>();
  watch.of_tbb = counts_in(report.at("tbb"));
  watch.calls = report.at("calls").get<std::string>();
  for (const json& thread : report.at("threads"))
    watch.threads.push_back({thread.at("name").get<std::string>(), thread.at("seen").get<std::uint64_t>(),
                             counts_in(thread.at("counts"))});
  return watch;
}

}  // namespace

std::vector<std::string> watch_environment(const fs::path& folder, bool plant) {
  const Result<fs::path> library = find_sibling_program(kLibrary);
  if (!library) return {};
  std::vector<std::string> environment{"LD_PRELOAD=" + library->string(),
                                       "NILIO_WATCH_REPORT=" + (folder / kReport).string()};
  if (plant) environment.emplace_back("NILIO_WATCH_PLANT=1");
  return environment;
}

Result<ThreadWatch> read_thread_watch(const fs::path& folder) {
  if (const Result<fs::path> library = find_sibling_program(kLibrary); !library)
    return Error{std::string(kLibrary) + " is not beside this program - build target nilio_watch"};
  const std::optional<std::string> text = file_text(folder / kReport);
  if (!text) return Error{"niliod ended before the end of its warm-up, or was killed"};
  const json report = json::parse(*text, nullptr, false);
  try {
    return parse(report);
  } catch (const json::exception& exception) {
    return Error{(folder / kReport).string() + ": is not what " + kLibrary + " writes (" + exception.what() +
                 ")"};
  }
}

std::uint64_t total(const NamedCounts& counts) {
  std::uint64_t sum = 0;
  for (const auto& [name, count] : counts) sum += count;
  return sum;
}

std::uint64_t forbidden_calls(const ThreadWatch& watch) {
  std::uint64_t sum = 0;
  for (const ThreadWatch::Thread& thread : watch.threads) sum += total(thread.counts);
  return sum;
}

}  // namespace nilio::tools::bench
