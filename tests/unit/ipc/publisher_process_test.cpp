#include "ipc/publisher_process.hpp"

#include "tests/support/eventually.hpp"
#include "tests/support/temporary_folder.hpp"

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <unistd.h>

#include <catch2/catch.hpp>

namespace {

using Catch::Matchers::Contains;
using nilio::core::Duration;
using nilio::ipc::PublisherEvent;
using nilio::ipc::PublisherProcess;
using nilio::ipc::PublisherProcessConfig;
using nilio::tests::eventually;
using nilio::tests::TemporaryFolder;
using Kind = PublisherEvent::Kind;

// Shell script in a folder of its own that replaces the publisher.
class FakePublisher {
 public:
  explicit FakePublisher(const std::string& script) {
    std::ofstream(path()) << "#!/bin/sh\ncd " << folder_.text() << "\n" << script << "\n";
    std::filesystem::permissions(path(), std::filesystem::perms::owner_all);
  }

  [[nodiscard]] std::filesystem::path path() const { return folder_.path() / "publisher.sh"; }
  // File content written by the script; waits until it ends with a line end.
  [[nodiscard]] std::string output(const std::string& name) const {
    std::string text;
    REQUIRE(eventually([&] {
      std::ostringstream read;
      read << std::ifstream(folder_.file(name)).rdbuf();
      text = read.str();
      return text.ends_with('\n');
    }));
    return text;
  }

 private:
  TemporaryFolder folder_;
};

PublisherProcessConfig config_for(const std::filesystem::path& executable) {
  PublisherProcessConfig config;
  config.executable = executable;
  config.ring_capacity = 8;
  config.start_interval = Duration::from_milliseconds(20.0);
  return config;
}

PublisherEvent wait_for_event(PublisherProcess& process) {
  std::optional<PublisherEvent> event;
  REQUIRE(eventually([&] {
    event = process.poll();
    return event.has_value();
  }));
  return *event;
}

}  // namespace

TEST_CASE("the publisher gets its settings as arguments and inherits only its own descriptors",
          "[publisher_process]") {
  const FakePublisher fake("ls /proc/self/fd > descriptors; echo \"$@\" > arguments; exec sleep 130");
  const int leak = open("/dev/null", O_RDONLY);  // NOLINT: without close-on-exec on purpose
  REQUIRE(leak >= 0);
  PublisherProcessConfig config = config_for(fake.path());
  config.domain = 42;
  config.interface_whitelist = {"127.0.0.1", "10.0.0.7"};
  config.odom_frame = "my odom";
  config.topic_prefix = "car";
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  const std::string arguments = fake.output("arguments");
  CHECK_THAT(arguments, Contains("--domain=42") && Contains("--interface=127.0.0.1") &&
                            Contains("--interface=10.0.0.7"));
  CHECK_THAT(arguments, Contains("--odom-frame=my odom") && Contains("--topic-prefix=car"));
  CHECK_THAT(arguments, Contains("--parent-pid=" + std::to_string(getpid())));
  // Descriptors 0 to 11; ls has one more for the folder it lists, and the shell may have one for its script.
  std::istringstream descriptors(fake.output("descriptors"));
  int descriptor = -1;
  int count = 0;
  while (descriptors >> descriptor) {
    ++count;
    CHECK(descriptor < 14);
  }
  CHECK(count >= 13);
  CHECK(count <= 14);
  close(leak);
}

TEST_CASE("the parameters of the IMU-rate poses are passed exactly, or omitted", "[publisher_process]") {
  const FakePublisher fake("echo \"$@\" > arguments; exec sleep 140");
  PublisherProcessConfig config = config_for(fake.path());
  SECTION("wanted") {
    config.imu_poses.emplace();
    config.imu_poses->propagation.T_base_imu.rotation = Eigen::Quaterniond(0.1, 0.7, -0.7, 0.1);
    config.imu_poses->propagation.T_base_imu.translation = {-0.81, 0.0, 2.0 / 3.0};
    config.imu_poses->slew.jump_rad = 1.0 / 3.0;
    auto process = PublisherProcess::create(config);
    REQUIRE(process.ok());
    REQUIRE((*process)->start().ok());
    const std::string arguments = fake.output("arguments");
    CHECK_THAT(arguments, Contains("--imu-rate ") && Contains("--imu-turn-jump=0.33333333333333331"));
    CHECK_THAT(arguments, Contains("--imu-orientation=0.69999999999999996,-0.69999999999999996,0."
                                   "10000000000000001,0.10000000000000001"));
    CHECK_THAT(arguments, Contains("--imu-position=-0.81000000000000005,0,0.66666666666666663"));
    CHECK((*process)->publish_sample({}));
    CHECK((*process)->samples().size() == 1);
  }
  SECTION("not wanted") {
    auto process = PublisherProcess::create(config);
    REQUIRE(process.ok());
    REQUIRE((*process)->start().ok());
    CHECK(fake.output("arguments").find("--imu-rate ") == std::string::npos);
    CHECK_FALSE((*process)->publish_sample({}));
    CHECK((*process)->samples().written() == 0);
  }
}

TEST_CASE("samples that find the ring full are counted and never block", "[publisher_process]") {
  PublisherProcessConfig config = config_for("/bin/true");
  config.imu_poses.emplace();
  config.sample_ring_capacity = 16;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  int accepted = 0;
  for (int i = 0; i < 50; ++i) accepted += (*process)->publish_sample({}) ? 1 : 0;
  CHECK(accepted == 16);
  CHECK((*process)->samples().dropped() == 34);
}

TEST_CASE("a publisher that does not end on request is killed", "[publisher_process]") {
  const FakePublisher fake("trap '' TERM; echo up > up; while :; do sleep 0.05; done");
  auto process = PublisherProcess::create(config_for(fake.path()));
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  REQUIRE(fake.output("up") == "up\n");
  CHECK((*process)->publish({}));
  const auto stopped = (*process)->stop(Duration::from_milliseconds(100.0));
  REQUIRE(stopped.has_value());
  CHECK(stopped->kind == Kind::kStopped);
  CHECK(stopped->signal == SIGKILL);
  CHECK(stopped->unpublished == 1);
  CHECK_FALSE((*process)->running());
  CHECK_FALSE((*process)->poll().has_value());
}

TEST_CASE("the signal that killed a publisher is reported", "[publisher_process]") {
  const FakePublisher fake("exec sleep 150");
  auto process = PublisherProcess::create(config_for(fake.path()));
  REQUIRE(process.ok());
  const auto pid = (*process)->start();
  REQUIRE(pid.ok());
  CHECK_FALSE((*process)->poll().has_value());
  kill(*pid, SIGKILL);
  const PublisherEvent died = wait_for_event(**process);
  CHECK(died.kind == Kind::kDied);
  CHECK(died.pid == *pid);
  CHECK(died.signal == SIGKILL);
  CHECK(died.exit_status == -1);
  CHECK_THAT(died.message, Contains("killed by signal 9"));
}

TEST_CASE("a publisher that does not read waiting poses is killed", "[publisher_process]") {
  const FakePublisher fake("exec sleep 160");
  PublisherProcessConfig config = config_for(fake.path());
  config.hang_timeout = Duration::from_milliseconds(100.0);
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());
  std::this_thread::sleep_for(std::chrono::milliseconds(150));
  CHECK_FALSE((*process)->poll().has_value());  // an empty ring is no reason
  CHECK((*process)->publish({}));
  CHECK(wait_for_event(**process).kind == Kind::kHung);
  CHECK(wait_for_event(**process).signal == SIGKILL);
}

TEST_CASE("a missing executable is an error with its name, and the start is repeated",
          "[publisher_process]") {
  auto process = PublisherProcess::create(config_for("/nonexistent/nilio-publisher"));
  REQUIRE(process.ok());
  const auto started = (*process)->start();
  REQUIRE_FALSE(started.ok());
  CHECK_THAT(started.error().message, Contains("/nonexistent/nilio-publisher") && Contains("No such file"));
  CHECK(wait_for_event(**process).kind == Kind::kStartFailed);
  CHECK_FALSE((*process)->stop().has_value());
}

TEST_CASE("poses that find the ring full are counted and never block", "[publisher_process]") {
  auto process = PublisherProcess::create(config_for("/bin/true"));
  REQUIRE(process.ok());
  int accepted = 0;
  for (int i = 0; i < 20; ++i) accepted += (*process)->publish({}) ? 1 : 0;
  CHECK(accepted == 8);
  CHECK((*process)->ring().dropped() == 12);
}
