#include "daemon/service/service_report.hpp"

#include "tests/support/notify_socket.hpp"
#include "tests/support/temporary_folder.hpp"

#include <cstdlib>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using Catch::Matchers::Contains;
using tests::NotifySocket;

namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

/// A service manager with a watchdog of 2 s, and a report to it.
struct Service {
  tests::TemporaryFolder folder;
  NotifySocket socket{folder.file("notify")};
  ServiceNotifier notifier = [this] {
    setenv("NOTIFY_SOCKET", socket.address().c_str(), 1);
    setenv("WATCHDOG_USEC", "2000000", 1);
    return ServiceNotifier::from_environment();
  }();
  ServiceReport report{notifier, 0};

  /// Reports `health` every 0.1 s in [begin_s, end_s).
  void run(double begin_s, double end_s, const ServiceHealth& health) {
    for (auto now = static_cast<std::int64_t>(begin_s * 1e9); now < static_cast<std::int64_t>(end_s * 1e9);
         now += kSecond / 10)
      report.update(now, health);
  }
};

ipc::PoseRecord pose(double latency_ms) {
  ipc::PoseRecord record;
  record.state = ipc::TrackingState::kTracking;
  record.stage_ns[static_cast<std::size_t>(ipc::Stage::kReceived)] = kSecond;
  record.stage_ns[static_cast<std::size_t>(ipc::Stage::kDelivered)] =
      kSecond + static_cast<std::int64_t>(latency_ms * 1e6);
  return record;
}

const ServiceHealth kGood{.is_ready = true, .makes_progress = true, .problems = {}};

}  // namespace

TEST_CASE("READY is sent once, when the run is ready, and a status line every second", "[service_report]") {
  Service service;
  service.run(0.0, 2.0, {.is_ready = false, .makes_progress = true, .problems = {"the publisher starts"}});
  CHECK(service.socket.count("READY=1") == 0);
  CHECK(service.socket.count("WATCHDOG=1") == 0);
  CHECK(service.socket.count("STATUS=starting; the publisher starts\n") == 1);
  service.run(2.0, 6.0, kGood);
  CHECK(service.socket.count("READY=1") == 1);
  CHECK(service.socket.count("STATUS=no poses\n") == 4);
}

TEST_CASE("the status line has state, rate, latency and problems, on one line", "[service_report]") {
  Service service;
  service.run(0.0, 0.1, kGood);
  for (const double latency_ms : {20.0, 21.0, 40.0, 19.0, 21.0}) service.report.add(pose(latency_ms));
  service.report.update(kSecond, {true, true, {"nilio-publisher does not run", "two\nlines"}});
  CHECK_THAT(service.socket.messages().back(),
             Contains("STATUS=tracking, 5.0 poses/s, latency 21.0 ms, at most 40.0 ms; nilio-publisher does "
                      "not run; two lines\n"));
  service.report.update(2 * kSecond, kGood);
  CHECK_THAT(service.socket.messages().back(), Contains("STATUS=no poses\n"));
}

TEST_CASE("the watchdog is fed at half its limit while progress is made, and not without",
          "[service_report]") {
  Service service;
  service.run(0.0, 5.0, kGood);
  CHECK(service.socket.count("WATCHDOG=1") == 5);
  service.run(5.0, 9.0, {.is_ready = true, .makes_progress = false, .problems = {"nilio-odometry hangs"}});
  CHECK(service.socket.count("WATCHDOG=1") == 5);
  CHECK(service.socket.count("nilio-odometry hangs") == 4);
  service.run(9.0, 9.1, kGood);
  CHECK(service.socket.count("WATCHDOG=1") == 6);
}

TEST_CASE("a reload is announced and ended, and its outcome stays in the status", "[service_report]") {
  Service service;
  service.report.begin_reload(0);
  CHECK(service.socket.messages().empty());
  service.run(0.0, 0.1, kGood);
  service.report.begin_reload(3 * kSecond / 2);
  CHECK(service.socket.messages().back() == "RELOADING=1\nMONOTONIC_USEC=1500000\n");
  service.report.end_reload("configuration keys that need a restart: 2");
  service.run(1.6, 4.0, kGood);
  CHECK(service.socket.count("READY=1") == 2);
  CHECK_THAT(service.socket.messages().back(),
             Contains("STATUS=no poses; configuration keys that need a restart: 2\n"));
}

TEST_CASE("stopping extends the time limits of stop and watchdog", "[service_report]") {
  Service service;
  service.report.stop(core::Duration::from_seconds(60.0));
  CHECK(service.socket.messages().back() ==
        "STOPPING=1\nSTATUS=finishing files\nEXTEND_TIMEOUT_USEC=60000000\nWATCHDOG_USEC=60000000\n");
}
