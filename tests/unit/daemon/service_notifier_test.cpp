#include "daemon/service/service_notifier.hpp"

#include "tests/support/notify_socket.hpp"
#include "tests/support/temporary_folder.hpp"

#include <cstdlib>
#include <string>
#include <unistd.h>
#include <utility>

#include <catch2/catch.hpp>

using namespace nilio;
using daemon::ServiceNotifier;
using tests::NotifySocket;

namespace {

ServiceNotifier notifier_for(const std::string& socket, const std::string& limit_us = "",
                             const std::string& pid = "") {
  setenv("NOTIFY_SOCKET", socket.c_str(), 1);
  if (!limit_us.empty()) setenv("WATCHDOG_USEC", limit_us.c_str(), 1);
  if (!pid.empty()) setenv("WATCHDOG_PID", pid.c_str(), 1);
  return ServiceNotifier::from_environment();
}

}  // namespace

TEST_CASE("messages arrive as datagrams at a socket in the file system and at an abstract one",
          "[service_notifier]") {
  const tests::TemporaryFolder folder;
  const bool is_abstract = GENERATE(false, true);
  const std::string address = is_abstract ? "@nilio-test-" + std::to_string(getpid()) : folder.file("notify");
  NotifySocket socket(address);
  ServiceNotifier first = notifier_for(address);
  const ServiceNotifier notifier = std::move(first);
  CHECK(notifier.is_connected());
  CHECK(notifier.send("READY=1\nSTATUS=tracking\n"));
  CHECK(notifier.send("STOPPING=1"));
  REQUIRE(socket.messages().size() == 2);
  CHECK(socket.messages()[0] == "READY=1\nSTATUS=tracking\n");
  CHECK(socket.messages()[1] == "STOPPING=1");
}

TEST_CASE("child processes do not inherit the variables of the service manager", "[service_notifier]") {
  const tests::TemporaryFolder folder;
  const ServiceNotifier notifier = notifier_for(folder.file("notify"), "3000000", std::to_string(getpid()));
  for (const char* name : {"NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"})
    CHECK(std::getenv(name) == nullptr);
}

TEST_CASE("the watchdog is fed at half of its limit, and only by the process that it watches",
          "[service_notifier]") {
  const tests::TemporaryFolder folder;
  const std::string socket = folder.file("notify");
  const std::string own = std::to_string(getpid());
  CHECK(notifier_for(socket, "3000000").ping_period() == core::Duration::from_seconds(1.5));
  CHECK(notifier_for(socket, "3000000", own).ping_period() == core::Duration::from_seconds(1.5));
  CHECK(notifier_for(socket, "3000000", "1").ping_period().ns == 0);
  CHECK(notifier_for(socket, "", own).ping_period().ns == 0);
  CHECK(notifier_for(socket, "soon", own).ping_period().ns == 0);
  CHECK(notifier_for(socket, "-5", own).ping_period().ns == 0);
}

TEST_CASE("without a usable socket of a service manager nothing is sent", "[service_notifier]") {
  unsetenv("NOTIFY_SOCKET");
  CHECK_FALSE(ServiceNotifier::from_environment().is_connected());
  CHECK_FALSE(ServiceNotifier::from_environment().send("READY=1"));
  for (const std::string& address :
       {std::string("relative/path"), std::string("vsock:2:1"), std::string(), "/" + std::string(200, 'x')})
    CHECK_FALSE(notifier_for(address, "3000000").is_connected());
}

TEST_CASE("a service manager that has gone or takes no messages neither blocks nor ends the process",
          "[service_notifier]") {
  const tests::TemporaryFolder folder;
  CHECK_FALSE(notifier_for(folder.file("nobody")).send("READY=1"));
  const NotifySocket silent(folder.file("silent"));
  const ServiceNotifier notifier = notifier_for(silent.address());
  std::size_t delivered = 0;
  while (delivered < 100'000 && notifier.send("WATCHDOG=1")) ++delivered;
  CHECK(delivered > 0);
  CHECK(delivered < 100'000);
}
