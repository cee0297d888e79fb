#pragma once

#include "daemon/odometry/pipeline.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/udp_support.hpp"

#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// Configuration for live sensors on this computer without privileges.
inline daemon::Config live_config(const std::vector<std::uint16_t>& ports) {
  daemon::Config config;
  config.realtime.policy = "other";
  config.realtime.lock_memory = false;
  config.imu.enabled = false;
  config.lidar.bind_address = "127.0.0.1";
  config.lidar.port = ports[0];
  config.lidar.position_port = 0;
  for (std::size_t i = 1; i < ports.size(); ++i) {
    daemon::ExtraLidarConfig& lidar = config.more_lidars[i - 1];
    lidar.enabled = true;
    lidar.bind_address = "127.0.0.1";
    lidar.port = ports[i];
    lidar.position_port = 0;
  }
  return config;
}

/// Pipeline on sockets that the test feeds.
class LiveRun {
 public:
  explicit LiveRun(const daemon::Config& config) {
    auto input = daemon::open_live(config);
    REQUIRE(input.ok());
    auto pipeline = daemon::Pipeline::create(config, std::move(input).value(),
                                             {.rules = daemon::RunRules::Kind::kLive}, nullptr);
    REQUIRE(pipeline.ok());
    pipeline_ = std::move(pipeline).value();
    sent_.resize(pipeline_->lidars().size());
    REQUIRE(pipeline_->start().ok());
  }

  /// Sends to LiDAR number `lidar` no faster than packets are read, so that the kernel drops none.
  void send(UdpSender& sender, std::size_t lidar, std::uint16_t port,
            std::span<const drivers::Packet> packets) {
    constexpr std::size_t kChunk = 32;
    while (!packets.empty()) {
      const auto chunk = packets.first(std::min(kChunk, packets.size()));
      for (const drivers::Packet& packet : chunk)
        sender.send(port, {packet.data.begin(), packet.data.begin() + packet.size});
      sent_[lidar] += chunk.size();
      REQUIRE(settle(lidar));
      packets = packets.subspan(chunk.size());
    }
  }

  void stop() {
    pipeline_->request_stop();
    pipeline_->join();
    collect();
  }

  /// Poses and log lines so far.
  void collect() {
    while (const auto record = pipeline_->poses().try_pop()) poses.push_back(*record);
    while (auto line = pipeline_->event_log().take()) lines.push_back(std::move(*line));
  }

  /// Lines of this level that contain `text`.
  [[nodiscard]] std::size_t count_lines(daemon::LogLevel level, const std::string& text) const {
    return static_cast<std::size_t>(std::count_if(lines.begin(), lines.end(), [&](const auto& line) {
      return line.level == level && line.text.find(text) != std::string::npos;
    }));
  }

  /// True if the receive thread of LiDAR number `lidar` has so many packets and its ring has free slots.
  [[nodiscard]] bool has_delivered(std::size_t lidar, std::uint64_t packets) const {
    const daemon::LidarInput& input = *pipeline_->lidars()[lidar];
    return input.source.stats().delivered >= packets && input.ring.size() < input.ring.capacity() - 100;
  }

  /// Waits until so many packets are read from the socket of LiDAR number `lidar`.
  [[nodiscard]] bool receives(std::size_t lidar, std::uint64_t packets) const {
    return eventually([&] { return pipeline_->lidars()[lidar]->source.stats().delivered >= packets; }, kPoll);
  }

  /// Waits until LiDAR number `lidar` has at most so many packets in its ring.
  [[nodiscard]] bool drains(std::size_t lidar, std::size_t packets) const {
    return eventually([&] { return pipeline_->lidars()[lidar]->ring.size() <= packets; }, kPoll);
  }

  [[nodiscard]] daemon::Pipeline& pipeline() { return *pipeline_; }

  std::vector<ipc::PoseRecord> poses;
  std::vector<daemon::EventLog::Line> lines;

 private:
  static constexpr std::chrono::microseconds kPoll{500};

  /// Waits until all sent packets are read from socket and ring.
  bool settle(std::size_t lidar) {
    const daemon::LidarInput& input = *pipeline_->lidars()[lidar];
    return eventually(
        [&] { return input.source.stats().delivered >= sent_[lidar] && input.ring.size() == 0; }, kPoll);
  }

  std::unique_ptr<daemon::Pipeline> pipeline_;
  std::vector<std::uint64_t> sent_;
};

}  // namespace nilio::tests
