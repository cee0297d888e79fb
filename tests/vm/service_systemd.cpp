// niliod.service under systemd, process 1 of the guest. The cases run in this order: the first one installs,
// the last one purges.

#include "drivers/can/socketcan/can_interface.hpp"
#include "tests/support/paths.hpp"
#include "tests/vm/emulated_controllers.hpp"
#include "tests/vm/niliod_run.hpp"
#include "tests/vm/service_unit.hpp"
#include "tests/vm/vm_support.hpp"

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <regex>
#include <string>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;
using namespace std::chrono_literals;
using Catch::Matchers::Contains;

namespace {

namespace fs = std::filesystem;

const ServiceUnit niliod("niliod");
constexpr const char* kConfig = "/etc/nilio/vehicle.yaml";
constexpr const char* kPoses = "^[a-z]+, [0-9.]+ poses/s, latency";

/// The Debian package of this build, or empty where it is not made: then its files are copied.
std::string package() { return std::getenv("NILIO_PACKAGE") == nullptr ? "" : std::getenv("NILIO_PACKAGE"); }

void write_config(const std::string& more = "") {
  std::ofstream(kConfig) << "lidar: {model: VLP-16, bind_address: 127.0.0.1}\n"
                            "publisher: {interfaces: [127.0.0.1]}\n"
                            "odometry: {registration_points: 1000}\n"
                         << (more.empty() ? "imu: {interface: can0}\n" : more);
}

void install() {
  // A guest on a busy computer stands still for seconds.
  fs::create_directories("/etc/systemd/system/niliod.service.d");
  std::ofstream("/etc/systemd/system/niliod.service.d/patience.conf")
      << "[Service]\nWatchdogSec=10s\nTimeoutStartSec=180s\n";
  if (!package().empty()) {
    // Containers forbid to start services at an installation.
    fs::remove("/usr/sbin/policy-rc.d");
    // An index of all man pages takes an emulated processor minutes, at the installation and at the purge.
    fs::remove("/var/lib/man-db/auto-update");
    REQUIRE(shell("dpkg --install " + package()) == 0);
    return;
  }
  REQUIRE(shell(std::string("cp -a '") + std::getenv("NILIO_STAGE") + "/.' /") == 0);
  fs::create_directories("/etc/nilio");
  write_config();
  REQUIRE(shell("systemd-sysusers nilio.conf && systemd-tmpfiles --create nilio.conf") == 0);
  REQUIRE(shell("/lib/systemd/systemd-sysctl 90-nilio.conf") == 0);
  REQUIRE(shell("systemctl daemon-reload") == 0);
  REQUIRE(niliod.control("start") == 0);
}

/// A field of /proc/PID/status.
std::string status_of(const std::string& pid, const std::string& field) {
  return output_of("sed -n 's/^" + field + ":[[:space:]]*//p' /proc/" + pid + "/status");
}

std::string publisher_pid() { return output_of("pgrep --exact nilio-publisher"); }

}  // namespace

TEST_CASE("installed and started without LiDAR and CAN, the service is ready, says so and stays",
          "[service_systemd]") {
  unplug_controllers();
  install();
  if (!package().empty()) {
    // The package starts nothing by itself.
    CHECK_FALSE(niliod.is_active());
    write_config();
    REQUIRE(niliod.control("start") == 0);
  }
  CHECK(niliod.await("StatusText", "^no poses; no scan for [0-9]+ s: .*nothing arrives"));
  CHECK(niliod.has_line("CAN can0: .*waiting for it"));
  // Longer than the watchdog's limit.
  std::this_thread::sleep_for(12s);
  CHECK(niliod.is_active());
  CHECK(niliod.restarts() == 0);

  const std::string main = niliod.property("MainPID");
  CHECK(output_of("ps --no-headers --format user --pid " + main) == "nilio");
  CHECK(status_of(main, "CapEff") == "0000000000000000");
  CHECK(status_of(main, "NoNewPrivs") == "1");
  CHECK(std::stol(status_of(main, "VmLck")) > 10'000);
  const std::string policies = output_of("ps -L --no-headers --format comm,cls,rtprio --pid " + main);
  CHECK(std::regex_search(policies, std::regex("nilio-odometry +FF +40")));
  CHECK(std::regex_search(policies, std::regex("nilio-lidar +FF +60")));
  CHECK(std::stol(output_of("cat /proc/sys/net/core/rmem_max")) >= 8'388'608);
  CHECK(shell("systemd-analyze security --threshold=17 niliod >/dev/null") == 0);
  CHECK(shell("test -d /var/lib/nilio -a -d /run/nilio") == 0);
}

TEST_CASE("the journal has priorities and one time stamp", "[service_systemd]") {
  const std::string journal = niliod.journal();
  INFO(journal);
  CHECK_THAT(journal, Contains("memory: locked") && Contains("publishing on DDS domain 0"));
  // The time and the name of the program are the journal's.
  CHECK_FALSE(std::regex_search(journal, std::regex("(^|\n)(<[0-9]>|[0-9-]{10}[ T])")));
  CHECK_THAT(journal, !Contains("niliod info:"));
  const std::string warnings = niliod.journal("--priority=warning");
  CHECK_THAT(warnings, Contains("no scan for") && !Contains("publishing on"));
}

TEST_CASE("with CAN set up by its unit and a LiDAR the service tracks, and without them it goes on",
          "[service_systemd]") {
  plug_in_controllers();
  // No device manager runs in this guest, hence no unit of the device.
  REQUIRE(shell("sed '/^BindsTo=/d; /^After=sys-sub/d' /lib/systemd/system/nilio-can@.service "
                ">/run/systemd/system/nilio-can@.service && systemctl daemon-reload") == 0);
  std::ofstream("/etc/nilio/can-can0.conf") << "BITRATE=250000\nRESTART_MS=200\n";
  REQUIRE(ServiceUnit("nilio-can@can0").control("start") == 0);
  CHECK(drivers::query_can_interface("can0").bitrate == 250000U);
  CHECK(drivers::query_can_interface("can0").restart_ms == 200U);
  drivers::set_up_can_interface("can1", 250000, 0);
  REQUIRE(eventually([] { return has_listener("can0"); }));

  NiliodRun run;
  run.write_drive(3.0);
  auto play = run.start_playing("can1");
  CHECK(niliod.await("StatusText", kPoses));
  const std::regex tracking("^tracking, ");
  holds_at_full_pace([&] { return std::regex_search(niliod.property("StatusText"), tracking); }, run, "can0",
                     "whether the service tracks", [] { return niliod.journal(); });
  CHECK(niliod.has_line("CAN can0: up, error-active, 250000 bit/s"));
  REQUIRE(ServiceUnit("nilio-can@can0").control("stop") == 0);
  CHECK(niliod.await("StatusText", "^[a-z]+, .* poses/s.*; (CAN can0: down|IMU silent)"));
  CHECK(play->stop(SIGTERM) >= 0);
  CHECK(niliod.await("StatusText", "^no poses; no scan for"));
  INFO(niliod.journal());
  CHECK(niliod.restarts() == 0);
  CHECK(niliod.is_active());
}

TEST_CASE("systemctl reload applies log.level, names what needs a restart, and refuses a wrong file",
          "[service_systemd]") {
  const pid_t before = niliod.main_pid();
  write_config("imu: {interface: can0}\nlog: {level: debug}\noutput: {map: false}\n");
  CHECK(niliod.control("reload") == 0);
  CHECK(niliod.has_line("reload: log.level: \"info\" -> \"debug\", applied"));
  CHECK(niliod.has_line("reload: output.map: true -> false, needs a restart of niliod"));
  CHECK(niliod.await("StatusText", "; configuration keys that need a restart: 1$"));
  write_config("imu: {interfaces: can0}\n");
  CHECK(niliod.control("reload") == 0);
  CHECK(niliod.await("StatusText", "; the new configuration is refused"));
  CHECK_THAT(niliod.journal("--priority=err"), Contains("reload: refused") && Contains("imu.interface"));
  write_config();
  CHECK(niliod.control("reload") == 0);
  CHECK(niliod.has_line("reload: log.level: \"debug\" -> \"info\", applied"));
  CHECK(niliod.await("ActiveState", "^active$"));
  CHECK(niliod.main_pid() == before);
}

TEST_CASE("a killed publisher is replaced by niliod, and a killed or stopped niliod by systemd",
          "[service_systemd]") {
  const pid_t before = niliod.main_pid();
  const std::string publisher = publisher_pid();
  REQUIRE(shell("kill -9 " + publisher) == 0);
  CHECK(eventually([&] { return !publisher_pid().empty() && publisher_pid() != publisher; }));
  CHECK(niliod.main_pid() == before);

  REQUIRE(shell("systemctl kill --kill-who=main --signal=KILL niliod") == 0);
  CHECK(niliod.await("NRestarts", "^1$"));
  CHECK(niliod.await("ActiveState", "^active$"));
  CHECK(niliod.main_pid() != before);

  REQUIRE(shell("systemctl kill --kill-who=main --signal=STOP niliod") == 0);
  CHECK(niliod.await("NRestarts", "^2$"));
  CHECK(niliod.await("ActiveState", "^active$"));
  CHECK(niliod.has_line("Watchdog timeout"));
}

TEST_CASE("a thread that hangs during a drive is named, and the watchdog starts the service again",
          "[service_systemd]") {
  std::ofstream("/run/nilio-hang") << "now";
  // The service sees neither the computer's /tmp nor its home folders.
  const fs::path library = "/usr/local/lib/nilio-hanging-odometry.so";
  fs::copy_file(program_folder() + "/libnilio-hanging-odometry.so", library,
                fs::copy_options::overwrite_existing);
  // Here niliod sets the controller up itself.
  niliod.configure(
      "CapabilityBoundingSet=CAP_NET_ADMIN\nAmbientCapabilities=CAP_NET_ADMIN\n"
      "Environment=LD_PRELOAD=" +
      library.string() + " NILIO_HANG_FILE=/run/nilio-hang\n");
  write_config("imu: {interface: can0, bitrate: 250000}\n");
  REQUIRE(niliod.control("restart") == 0);
  CHECK(niliod.has_line("CAN can0: set to 250000 bit/s and started"));
  CHECK(status_of(niliod.property("MainPID"), "CapEff") == "0000000000001000");
  CHECK(status_of(publisher_pid(), "CapEff") == "0000000000000000");
  CHECK(shell("systemd-analyze security --threshold=20 niliod >/dev/null") == 0);

  NiliodRun run;
  run.write_drive(3.0);
  drivers::set_up_can_interface("can1", 250000, 0);
  const auto play = run.start_playing("can1");
  CHECK(niliod.has_line("nilio-odometry: hangs, no progress for"));
  CHECK(niliod.await("NRestarts", "^1$"));
  fs::remove("/run/nilio-hang");
  CHECK(niliod.has_line("Watchdog timeout"));
  CHECK(niliod.await("StatusText", kPoses));
  fs::remove(library);
}

TEST_CASE("a second vehicle runs beside the first", "[service_systemd]") {
  fs::copy_file(kConfig, "/etc/nilio/second.yaml", fs::copy_options::overwrite_existing);
  std::ofstream("/etc/nilio/second.yaml")
      << "lidar: {port: 2370, position_port: 8310, bind_address: 127.0.0.1}\n"
         "imu: {enabled: false}\npublisher: {enabled: false}\n";
  const ServiceUnit second("niliod@second");
  CHECK(second.control("start") == 0);
  CHECK(second.is_active());
  CHECK(fs::is_directory("/var/lib/nilio/second"));
  CHECK(second.control("stop") == 0);
  // An instance without a configuration does not start.
  const ServiceUnit third("niliod@third");
  CHECK(third.control("start") == 0);
  CHECK(third.property("ConditionResult") == "no");
}

TEST_CASE("stopped, the service writes its files; purged, nothing is left of it", "[service_systemd]") {
  niliod.configure("ExecStart=\nExecStart=/usr/bin/niliod --config /etc/nilio/vehicle.yaml --output run\n");
  write_config();
  REQUIRE(niliod.control("restart") == 0);
  REQUIRE(niliod.control("stop") == 0);
  CHECK(niliod.property("Result") == "success");
  CHECK(niliod.property("ActiveState") == "inactive");
  CHECK(fs::exists("/var/lib/nilio/run/latency.json"));
  CHECK(output_of("pgrep nilio").empty());
  if (package().empty()) return;
  REQUIRE(niliod.control("start") == 0);
  REQUIRE(shell("dpkg --purge nilio") == 0);
  CHECK(output_of("pgrep nilio").empty());
  CHECK(output_of("getent passwd nilio; getent group nilio").empty());
  // The guest's own files, without the test's drop-ins and instances.
  CHECK(output_of("find /memory /run -xdev -name '*nilio*' -not -type c -not -path "
                  "'/memory/etc/systemd/system/nilio*' "
                  "-not -path '/run/nilio-*' -not -path '/run/systemd/*'") == "");
}
