#include "daemon/service/config_reload.hpp"

#include "daemon/config/schema.hpp"

#include <chrono>
#include <exception>
#include <utility>

namespace nilio::daemon {

using core::Error;
using core::Result;

std::string ReloadReport::problem() const {
  if (refused) return "the new configuration is refused, see the log";
  if (need_restart == 0) return "";
  return "configuration keys that need a restart: " + std::to_string(need_restart);
}

ReloadReport reload_config(Config& running, const Result<Config>& loaded) {
  ReloadReport report;
  if (!loaded) {
    report.refused = true;
    report.lines = {"reload: refused, the running configuration stays in force: " + loaded.error().message};
    return report;
  }
  for (const ConfigChange& change : find_changes(running, *loaded)) {
    std::string line = "reload: " + change.key + ": " + change.from + " -> " + change.to;
    const bool is_live = change.reload == ReloadClass::kApplied;
    if (is_live && apply_override(running, change.key + "=" + change.to)) {
      ++report.applied;
      line += ", applied";
    } else {
      ++report.need_restart;
      line += ", needs a restart of niliod";
    }
    report.lines.push_back(std::move(line));
  }
  const std::size_t unchanged = config_keys(running).size() - report.applied - report.need_restart;
  report.lines.push_back("reload: keys: " + std::to_string(report.applied) + " applied, " +
                         std::to_string(report.need_restart) + " need a restart, " +
                         std::to_string(unchanged) + " unchanged");
  return report;
}

ConfigReader::~ConfigReader() {
  // It waits in the kernel and cannot be ended.
  if (thread_) static_cast<void>(thread_.release());
}

void ConfigReader::start(Load load) {
  const auto loaded = std::make_shared<std::promise<Result<Config>>>();
  read_ = loaded->get_future();
  thread_ = std::make_unique<PlanThread>([loaded, load = std::move(load)] {
    try {
      loaded->set_value(load());
    } catch (const std::exception& exception) {
      loaded->set_value(Error{exception.what()});
    }
  });
}

std::optional<Result<Config>> ConfigReader::take() {
  if (!read_.valid() || read_.wait_for(std::chrono::seconds(0)) != std::future_status::ready)
    return std::nullopt;
  thread_->join();
  thread_.reset();
  return read_.get();
}

}  // namespace nilio::daemon
