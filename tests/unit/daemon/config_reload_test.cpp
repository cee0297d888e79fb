#include "daemon/service/config_reload.hpp"

#include "tests/support/eventually.hpp"

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;

TEST_CASE("a reload applies what may change and names the keys that need a restart", "[config_reload]") {
  Config running;
  Config loaded;
  loaded.log.level = "debug";
  loaded.lidar.port = 2370;
  loaded.publisher.interfaces = {"127.0.0.1"};
  ReloadReport report = reload_config(running, loaded);
  CHECK_FALSE(report.refused);
  CHECK(report.applied == 1);
  CHECK(report.need_restart == 2);
  CHECK(running.log.level == "debug");
  CHECK(running.lidar.port == 2368);
  CHECK(running.publisher.interfaces.empty());
  REQUIRE(report.lines.size() == 4);
  CHECK(report.lines[0] == "reload: lidar.port: 2368 -> 2370, needs a restart of niliod");
  CHECK(report.lines[1] == "reload: publisher.interfaces: [] -> [127.0.0.1], needs a restart of niliod");
  CHECK(report.lines[2] == "reload: log.level: \"info\" -> \"debug\", applied");
  CHECK(report.lines[3].find("reload: keys: 1 applied, 2 need a restart, ") == 0);
  CHECK(report.problem() == "configuration keys that need a restart: 2");

  // They still need it, although nothing has changed since.
  report = reload_config(running, loaded);
  CHECK(report.applied == 0);
  CHECK(report.need_restart == 2);
  report = reload_config(running, Config{});
  CHECK(running.log.level == "info");
  CHECK(report.problem().empty());
}

TEST_CASE("a refused configuration changes nothing, and the reason is told", "[config_reload]") {
  Config running;
  const ReloadReport report = reload_config(running, core::Error{"vehicle.yaml:3: log.levle is unknown"});
  CHECK(report.refused);
  REQUIRE(report.lines.size() == 1);
  CHECK(report.lines[0].find("vehicle.yaml:3: log.levle is unknown") != std::string::npos);
  CHECK_FALSE(report.problem().empty());
}

TEST_CASE("the configuration is read in the background, and an exception is an error", "[config_reload]") {
  ConfigReader reader;
  CHECK_FALSE(reader.is_reading());
  CHECK_FALSE(reader.take().has_value());
  std::atomic<bool> may_end{false};
  reader.start([&]() -> core::Result<Config> {
    while (!may_end) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return Config{};
  });
  CHECK(reader.is_reading());
  CHECK_FALSE(reader.take().has_value());
  may_end = true;
  std::optional<core::Result<Config>> read;
  const auto take = [&] {
    read = reader.take();
    return read.has_value();
  };
  REQUIRE(tests::eventually(take));
  CHECK(read->ok());
  CHECK_FALSE(reader.is_reading());
  reader.start([]() -> core::Result<Config> { throw std::runtime_error("no memory"); });
  REQUIRE(tests::eventually(take));
  REQUIRE_FALSE(read->ok());
  CHECK(read->error().message == "no memory");
}
