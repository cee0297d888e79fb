#pragma once

#include "ipc/dds/odometry_publisher.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/publisher_process.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/test_domain.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <istream>
#include <memory>
#include <optional>
#include <string>
#include <sys/wait.h>
#include <unistd.h>

#include <catch2/catch.hpp>

namespace nilio::tests {

inline dds::ParticipantConfig loopback(std::uint32_t domain) {
  dds::ParticipantConfig config;
  config.domain = domain;
  config.interface_whitelist = {"127.0.0.1"};
  return config;
}

/// CLOCK_MONOTONIC.
inline std::int64_t monotonic_ns() {
  return std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

inline ipc::PoseRecord sample_record(std::uint64_t sequence) {
  ipc::PoseRecord record;
  record.sequence = sequence;
  record.stamp_ns = 1'700'000'000'000'000'000 + static_cast<std::int64_t>(sequence) * 100'000'000 + 7;
  record.scan_start_ns = record.stamp_ns - 100'000'000;
  record.position = {0.1 * static_cast<double>(sequence), -3.25, 1e-9};
  record.orientation_xyzw = {0.1, -0.2, 0.3, 0.9};
  for (std::size_t i = 0; i < 36; ++i) {
    record.pose_covariance[i] = 1.0 / static_cast<double>(i + 1);
    record.drift_covariance[i] = 2.0 / static_cast<double>(i + 1);
    record.twist_covariance[i] = -1.0 / static_cast<double>(i + 3);
  }
  record.linear_velocity = {13.9, 0.01, -0.02};
  record.angular_velocity = {1e-3, -2e-3, 0.3};
  const std::int64_t now = monotonic_ns();
  for (std::size_t i = 0; i < ipc::kStageCount; ++i)
    record.stage_ns[i] = now - 1'000'000 * static_cast<std::int64_t>(ipc::kStageCount - 1 - i);
  return record;
}

inline std::unique_ptr<dds::OdometryPublisher> make_publisher(std::uint32_t domain) {
  dds::OdometryPublisherConfig config;
  config.participant = loopback(domain);
  auto publisher = dds::OdometryPublisher::create(config);
  if (!publisher) FAIL(publisher.error().message);
  return std::move(publisher).value();
}

/// For an OdometryPublisher or an ImuPosePublisher.
template <class Publisher>
bool wait_for_subscriber(const Publisher& publisher) {
  return eventually([&] { return publisher.subscribers() > 0; });
}

/// Maximum time for a message or the end of a program on a busy computer.
inline constexpr core::Duration kPatience{60'000'000'000};

inline std::optional<std::filesystem::path> built_program(const char* name) {
  const std::filesystem::path path = std::filesystem::path(program_folder()) / name;
  if (std::filesystem::exists(path)) return path;
  WARN("skipped: " << path << " is not built");
  return std::nullopt;
}

inline ipc::PublisherProcessConfig process_config(const std::filesystem::path& executable,
                                                  std::uint32_t domain) {
  ipc::PublisherProcessConfig config;
  config.executable = executable;
  config.domain = domain;
  config.interface_whitelist = {"127.0.0.1"};
  config.nice = 0;
  return config;
}

// Standard output of a program, which is killed if it runs longer than the object.
class Program {
 public:
  explicit Program(const std::string& command) {
    std::array<int, 2> ends{};
    REQUIRE(pipe2(ends.data(), O_CLOEXEC) == 0);
    pid_ = fork();
    REQUIRE(pid_ >= 0);
    if (pid_ == 0) {
      setpgid(0, 0);  // with all that the shell starts
      dup2(ends[1], STDOUT_FILENO);
      execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
      _exit(127);
    }
    close(ends[1]);
    pipe_ = fdopen(ends[0], "r");
  }
  ~Program() {
    kill(-pid_, SIGKILL);
    exit_status();
    std::fclose(pipe_);
  }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  std::optional<std::string> line() {
    std::string text;
    std::array<char, 4096> part{};
    while (std::fgets(part.data(), static_cast<int>(part.size()), pipe_) != nullptr) {
      text += part.data();
      if (text.back() != '\n') continue;
      text.pop_back();
      return text;
    }
    return std::nullopt;
  }
  int exit_status() {
    int status = 0;
    waitpid(pid_, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  pid_t pid_ = -1;
  std::FILE* pipe_ = nullptr;
};

// Peers in both directions, because loopback has no multicast.
inline constexpr const char* kCycloneLoopback =
    "CYCLONEDDS_URI='<CycloneDDS><Domain><General><Interfaces><NetworkInterface "
    "address=\"127.0.0.1\"/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<Peers><Peer Address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>' ";

inline std::unique_ptr<dds::OdometrySubscriber> make_subscriber(std::uint32_t domain) {
  auto subscriber = dds::OdometrySubscriber::create({.participant = loopback(domain), .topic_prefix = ""});
  if (!subscriber) FAIL(subscriber.error().message);
  return std::move(subscriber).value();
}

template <std::size_t N>
void read_numbers(std::istream& in, std::array<double, N>& numbers) {
  for (double& number : numbers) {
    std::string text;
    in >> text;
    number = std::strtod(text.c_str(), nullptr);  // istream cannot read hexadecimal floating point
  }
}

inline core::Time read_stamp(std::istream& in) {
  std::int64_t seconds = 0;
  std::int64_t nanoseconds = 0;
  in >> seconds >> nanoseconds;
  return {seconds * 1'000'000'000 + nanoseconds};
}

inline dds::Odometry parse_odometry(std::istream& in) {
  dds::Odometry odometry;
  odometry.stamp = read_stamp(in);
  in >> odometry.frame_id >> odometry.child_frame_id;
  read_numbers(in, odometry.position);
  read_numbers(in, odometry.orientation_xyzw);
  read_numbers(in, odometry.pose_covariance);
  read_numbers(in, odometry.linear_velocity);
  read_numbers(in, odometry.angular_velocity);
  read_numbers(in, odometry.twist_covariance);
  return odometry;
}

}  // namespace nilio::tests
