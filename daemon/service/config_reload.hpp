#pragma once

#include "nilio/core/result.hpp"

#include "daemon/config/config.hpp"
#include "daemon/realtime/thread_plan.hpp"

#include <cstddef>
#include <functional>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::daemon {

/// Outcome of a reload: one line per key that differs from the running configuration, or the reason why the
/// new one is refused.
struct ReloadReport {
  bool refused = false;
  std::vector<std::string> lines;
  std::size_t applied = 0;
  std::size_t need_restart = 0;
  /// One phrase for the status line; empty if the running configuration is the one in the files.
  [[nodiscard]] std::string problem() const;
};

/// Takes over the keys of `loaded` that may change while niliod runs; the others of `running` stay.
ReloadReport reload_config(Config& running, const core::Result<Config>& loaded);

/// Reads the configuration again in a thread of its own, so that a disk that does not answer delays nobody.
/// One thread calls.
class ConfigReader {
 public:
  using Load = std::function<core::Result<Config>()>;

  ConfigReader() = default;
  ConfigReader(const ConfigReader&) = delete;
  ConfigReader& operator=(const ConfigReader&) = delete;
  /// A thread that still reads is left to end with the program.
  ~ConfigReader();
  /// Starts reading; call only while nothing is read.
  void start(Load load);
  [[nodiscard]] bool is_reading() const { return read_.valid(); }
  /// The configuration, once it is read.
  std::optional<core::Result<Config>> take();

 private:
  std::future<core::Result<Config>> read_;
  std::unique_ptr<PlanThread> thread_;
};

}  // namespace nilio::daemon
