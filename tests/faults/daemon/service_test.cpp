#include "tests/support/eventually.hpp"
#include "tests/support/niliod_process.hpp"
#include "tests/support/notify_socket.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/room_drive.hpp"

#include <chrono>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace std::chrono_literals;
using Catch::Matchers::Contains;
using tests::count_lines;
using tests::kNoPublisher;
using tests::NiliodProcess;
using tests::NotifySocket;
using tests::read_file;
using tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

/// A drive, replayed under live rules as a service with a watchdog.
struct Service {
  explicit Service(double seconds) {
    tests::write_room_drive(folder.path(), tests::s_curve, seconds, true);
    configure("log: {level: info}\n");
  }
  void configure(const std::string& yaml) const {
    static_cast<void>(folder.write("vehicle.yaml", "realtime: {lock_memory: false}\n" + yaml));
  }
  [[nodiscard]] NiliodProcess start(std::vector<std::string> settings,
                                    NiliodProcess::Environment environment = {},
                                    const fs::path& program = fs::path(nilio::tests::program_folder()) /
                                                              "niliod") {
    environment.emplace_back("NOTIFY_SOCKET", socket.address());
    environment.emplace_back("WATCHDOG_USEC", "1000000");
    std::vector<std::string> arguments{
        "--replay", folder.text(), "--as-live", "--config", folder.file("vehicle.yaml"),
        "--output", run.string()};
    for (std::string& setting : settings) arguments.insert(arguments.end(), {"--set", std::move(setting)});
    return {folder, arguments, environment, program};
  }
  [[nodiscard]] std::size_t poses() const { return count_lines(run / "trajectory.tum"); }

  TemporaryFolder folder;
  NotifySocket socket{folder.file("notify")};
  fs::path run = folder.path() / "run";
};

// The recording is not replayed to its end.
constexpr int kStoppedReplay = 1;

}  // namespace

TEST_CASE("the service manager is told readiness, state and the end, and the publisher has no part in it",
          "[service]") {
  Service service(30.0);
  NiliodProcess niliod = service.start({tests::own_domain(), "publisher.interfaces=[\"127.0.0.1\"]"});
  const std::string publisher = niliod.await("nilio-publisher started, pid ([0-9]+)");
  REQUIRE_FALSE(publisher.empty());
  // Empty until the process has become nilio-publisher.
  std::string environment;
  CHECK(tests::eventually([&] {
    environment = read_file("/proc/" + publisher + "/environ");
    return environment.find("PATH=") != std::string::npos;
  }));
  CHECK_THAT(environment, !Contains("NOTIFY_SOCKET") && !Contains("WATCHDOG"));
  REQUIRE(service.socket.await("READY=1\n"));
  CHECK_THAT(niliod.output(), Contains("publishing on DDS domain"));
  CHECK(service.socket.await("STATUS=tracking, "));
  CHECK(service.socket.await("WATCHDOG=1\n", 4));

  kill(niliod.pid(), SIGTERM);
  REQUIRE(service.socket.await("STOPPING=1\n"));
  const auto finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == kStoppedReplay);
  CHECK(fs::exists(service.run / "latency.json"));
  CHECK_THAT(service.socket.messages().back(), Contains("STOPPING=1\n"));
}

TEST_CASE("a publisher that ends at once keeps the service from being ready, and the status says so",
          "[service]") {
  Service service(30.0);
  // niliod takes the publisher from its own folder; this one knows none of its options.
  const fs::path alone = service.folder.path() / "bin";
  fs::create_directory(alone);
  fs::copy_file(fs::path(nilio::tests::program_folder()) / "niliod", alone / "niliod");
  fs::copy_file("/bin/false", alone / "nilio-publisher");
  NiliodProcess niliod = service.start({}, {}, alone / "niliod");
  REQUIRE(service.socket.await("STATUS=starting; nilio-publisher does not run"));
  REQUIRE(tests::eventually([&] { return service.poses() >= 5; }));
  CHECK(service.socket.count("READY=1") == 0);
  kill(niliod.pid(), SIGTERM);
  CHECK(niliod.wait().status == kStoppedReplay);
}

TEST_CASE("a hanging thread starves the watchdog and is named in the status", "[service]") {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  WARN("skipped: sanitizers do not accept a preloaded library");
#else
  Service service(60.0);
  const std::string flag = service.folder.write("hang", "");
  NiliodProcess niliod = service.start(
      {kNoPublisher}, {{"LD_PRELOAD", nilio::tests::program_folder() + "/libnilio-hanging-odometry.so"},
                       {"NILIO_HANG_FILE", flag}});
  REQUIRE(service.socket.await("nilio-odometry hangs"));
  const std::size_t pings = service.socket.count("WATCHDOG=1");
  CHECK(pings > 0);
  std::this_thread::sleep_for(2s);
  CHECK(service.socket.count("WATCHDOG=1") == pings);
  fs::remove(flag);
  kill(niliod.pid(), SIGTERM);
  CHECK(niliod.wait().status == kStoppedReplay);
#endif
}

TEST_CASE("SIGHUP reads the configuration again and says what becomes of each key, while the run goes on",
          "[service]") {
  Service service(60.0);
  NiliodProcess niliod = service.start({kNoPublisher});
  REQUIRE(service.socket.await("STATUS=tracking, "));
  REQUIRE(tests::eventually([&] { return service.poses() >= 5; }));

  service.configure("log: {level: debug}\nodometry: {threads: 2}\n");
  kill(niliod.pid(), SIGHUP);
  CHECK_FALSE(niliod.await("(reload: log.level: \"info\" -> \"debug\", applied)").empty());
  CHECK_FALSE(niliod.await("(reload: odometry.threads: 1 -> 2, needs a restart of niliod)").empty());
  CHECK_FALSE(niliod.await("(reload: keys: 1 applied, 1 need a restart, [0-9]+ unchanged)").empty());
  CHECK(service.socket.await("RELOADING=1\nMONOTONIC_USEC="));
  CHECK(service.socket.await("READY=1", 2));
  CHECK(service.socket.await("; configuration keys that need a restart: 1"));

  service.configure("log: {level: warn}\nodometry: {thread: 2}\n");
  kill(niliod.pid(), SIGHUP);
  CHECK_FALSE(niliod.await("error: reload: refused[^\\n]*(odometry.thread)").empty());
  CHECK(service.socket.await("; the new configuration is refused"));

  service.configure("log: {level: warn}\n");
  kill(niliod.pid(), SIGHUP);
  CHECK(service.socket.await("READY=1", 4));
  CHECK_FALSE(niliod.await("(reload: log.level: \"debug\" -> \"warn\", applied)").empty());
  // The new level is in force, and poses are written as before.
  const std::size_t lines = count_lines(service.folder.path() / "niliod.log");
  const std::size_t poses = service.poses();
  CHECK(tests::eventually([&] { return service.poses() >= poses + 20; }));
  CHECK(count_lines(service.folder.path() / "niliod.log") == lines);
  kill(niliod.pid(), SIGTERM);
  const auto finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == kStoppedReplay);
  CHECK(service.poses() > poses);
}

TEST_CASE("without a service manager SIGHUP is a reload, too, and ends no run", "[service]") {
  const TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 3.0, true);
  NiliodProcess niliod(folder, {"--replay", folder.text(), "--as-live", "--set", kNoPublisher, "--set",
                                "realtime.lock_memory=false", "--output", folder.file("run")});
  REQUIRE_FALSE(niliod.await("(initialising -> tracking)").empty());
  kill(niliod.pid(), SIGHUP);
  CHECK_FALSE(niliod.await("(reload: keys: 0 applied, 0 need a restart)").empty());
  const auto finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == 0);
  CHECK(count_lines(folder.path() / "run" / "trajectory.tum") >= 28);
}
