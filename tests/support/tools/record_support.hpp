#pragma once

#include "nilio/drivers/capture/pcap.hpp"

#include "daemon/input/input.hpp"
#include "tests/support/drivers_support.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/read_all.hpp"
#include "tests/support/temporary_folder.hpp"

#include <arpa/inet.h>
#include <array>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <netinet/in.h>
#include <string>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

inline sockaddr_in loopback_address(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

/// A bound UDP socket on its own port.
class LoopbackSocket {
 public:
  LoopbackSocket() : descriptor_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_in address = loopback_address(0);
    socklen_t length = sizeof(address);
    REQUIRE(bind(descriptor_, reinterpret_cast<const sockaddr*>(&address), length) == 0);
    REQUIRE(getsockname(descriptor_, reinterpret_cast<sockaddr*>(&address), &length) == 0);
    port_ = ntohs(address.sin_port);
  }
  LoopbackSocket(const LoopbackSocket&) = delete;
  LoopbackSocket& operator=(const LoopbackSocket&) = delete;
  ~LoopbackSocket() { close(descriptor_); }
  [[nodiscard]] std::uint16_t port() const { return port_; }

  void send(std::uint16_t port, const std::vector<std::uint8_t>& payload) const {
    const sockaddr_in to = loopback_address(port);
    REQUIRE(sendto(descriptor_, payload.data(), payload.size(), 0, reinterpret_cast<const sockaddr*>(&to),
                   sizeof(to)) == static_cast<ssize_t>(payload.size()));
  }

 private:
  int descriptor_;
  std::uint16_t port_ = 0;
};

/// A port that was free at the time of the call.
inline std::uint16_t free_port() { return LoopbackSocket().port(); }

/// Packet with the size of a data packet and its number at the front.
inline std::vector<std::uint8_t> numbered_payload(std::uint32_t number) {
  std::vector<std::uint8_t> payload(1206, static_cast<std::uint8_t>(number));
  std::memcpy(payload.data(), &number, sizeof(number));
  return payload;
}

inline std::uint32_t number_of(const drivers::Packet& packet) {
  std::uint32_t number = 0;
  std::memcpy(&number, packet.data.data(), sizeof(number));
  return number;
}

inline std::vector<std::uint8_t> payload_bytes(const drivers::Packet& packet) {
  return {packet.data.begin(), packet.data.begin() + packet.size};
}

/// Every packet of a recording, of all ports.
inline std::vector<drivers::Packet> read_recording(const std::string& path, std::uint16_t data_port,
                                                   std::uint16_t position_port = 1) {
  const auto files = daemon::find_replay_files({path});
  REQUIRE(files.ok());
  auto source =
      drivers::chain_captures(files->captures, {.data_port = data_port, .position_port = position_port});
  REQUIRE(source.ok());
  const std::vector<drivers::Packet> packets = read_all(**source);
  INFO((*source)->status());
  CHECK((*source)->stats().other == 0);
  return packets;
}

inline std::vector<std::uint32_t> numbers_of(const std::vector<drivers::Packet>& packets) {
  std::vector<std::uint32_t> numbers;
  for (const drivers::Packet& packet : packets) numbers.push_back(number_of(packet));
  return numbers;
}

inline std::vector<std::uint32_t> count_up(std::size_t count) {
  std::vector<std::uint32_t> numbers(count);
  for (std::size_t i = 0; i < count; ++i) numbers[i] = static_cast<std::uint32_t>(i);
  return numbers;
}

inline void write_capture(const std::filesystem::path& path, const std::vector<drivers::Packet>& packets) {
  std::vector<std::uint8_t> bytes;
  drivers::append_pcap_header(bytes);
  for (const drivers::Packet& packet : packets) REQUIRE(drivers::append_pcap_record(bytes, packet));
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()), static_cast<std::streamsize>(bytes.size()));
}

/// A VLP-16's packets at their own pace, a position packet after every 14th.
inline std::vector<drivers::Packet> sensor_packets(std::size_t count, std::uint16_t data_port,
                                                   std::uint16_t position_port) {
  const TurningSensor sensor{.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16)};
  std::vector<drivers::Packet> packets;
  for (std::size_t i = 0; i < count; ++i) {
    packets.push_back(sensor.packet(i));
    packets.back().destination_port = data_port;
    if (i % 14 != 13) continue;
    drivers::Packet position;
    position.stamp = packets.back().stamp;
    position.destination_port = position_port;
    position.size = 512;
    position.data.fill(static_cast<std::uint8_t>(i));
    packets.push_back(position);
  }
  return packets;
}

/// `nilio` with both output streams in a file beside the recording.
class NilioProcess {
 public:
  /// `shell`: shell commands before it, such as limits.
  NilioProcess(std::filesystem::path log, const std::string& arguments, const std::string& shell = "")
      : log_(std::move(log)), pid_(fork()) {
    if (pid_ != 0) return;
    const std::string command =
        shell + " exec " + program_folder() + "/nilio " + arguments + " > " + log_.string() + " 2>&1";
    execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    _exit(127);
  }
  NilioProcess(const NilioProcess&) = delete;
  NilioProcess& operator=(const NilioProcess&) = delete;
  ~NilioProcess() {
    if (pid_ > 0) end(SIGKILL);
  }
  [[nodiscard]] std::string output() const { return read_file(log_); }
  [[nodiscard]] bool says(const std::string& text) const {
    return eventually([&] { return output().find(text) != std::string::npos; });
  }
  /// Exit status, or the negative signal; 0 = waits for the end without a signal.
  int end(int signal) {
    if (signal != 0) kill(pid_, signal);
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

 private:
  std::filesystem::path log_;
  pid_t pid_;
};

}  // namespace nilio::tests
