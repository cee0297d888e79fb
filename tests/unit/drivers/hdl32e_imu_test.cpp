#include "nilio/drivers/imu/hdl32e_imu.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/paths.hpp"

#include <array>
#include <cmath>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;

namespace {

constexpr std::int64_t kPeriodNs = 5'000'000;

core::ImuSample motion() {
  core::ImuSample motion;
  motion.angular_velocity = {0.1, -0.2, 0.3};
  motion.linear_acceleration = {1.0, -2.0, 9.5};
  return motion;
}

/// Mean of all samples of a recording.
core::ImuSample mean_motion(const std::string& path) {
  auto source = open_pcap(path, {});
  REQUIRE(source.ok());
  std::vector<Packet> packets(64);
  core::ImuSample mean;
  double count = 0.0;
  for (SourceRead read = (*source)->read(packets, {}); read.state == SourceState::kData;
       read = (*source)->read(packets, {})) {
    for (const Packet& packet : std::span(packets).first(read.count)) {
      const auto position = parse_position_packet(std::span(packet.data).first(packet.size));
      if (!position) continue;
      REQUIRE(position->motion.has_value());
      const core::ImuSample sample = motion_of(*position->motion);
      count += 1.0;
      for (std::size_t i = 0; i < 3; ++i) {
        mean.angular_velocity[i] += (sample.angular_velocity[i] - mean.angular_velocity[i]) / count;
        mean.linear_acceleration[i] += (sample.linear_acceleration[i] - mean.linear_acceleration[i]) / count;
      }
    }
  }
  return mean;
}

}  // namespace

TEST_CASE("boards encode a motion and give it back", "[hdl32e_imu]") {
  const core::ImuSample truth = motion();
  PositionPacket packet;
  packet.motion = boards_of(truth, 40.0);
  const auto parsed = parse_position_packet(encode_position_packet(packet));
  REQUIRE(parsed->motion.has_value());
  const core::ImuSample sample = motion_of(*parsed->motion);
  for (std::size_t i = 0; i < 3; ++i) {
    CHECK(sample.angular_velocity[i] == Approx(truth.angular_velocity[i]).margin(0.001));
    CHECK(sample.linear_acceleration[i] == Approx(truth.linear_acceleration[i]).margin(0.007));
  }
}

TEST_CASE("uneven packets become even samples, and faults are counted", "[hdl32e_imu]") {
  Hdl32eImu imu;
  const core::Time start{1'700'000'000'000'000'000};
  core::ImuSample sample = motion();
  std::vector<core::ImuSample> samples;
  const auto receive = [&](std::int64_t ns) {
    // A ramp, which interpolation keeps.
    sample.angular_velocity[2] = static_cast<double>(ns) * 1e-9;
    PositionPacket packet;
    packet.motion = boards_of(sample, 40.0);
    imu.add(*packet.motion, start + core::Duration{ns});
    while (const auto taken = imu.take()) samples.push_back(*taken);
  };
  std::int64_t now_ns = 0;
  for (int i = 0; i < 200; ++i) receive(now_ns += i % 2 == 0 ? 8'600'000 : 1'400'000);
  // From the first packet on.
  CHECK(samples.size() == 199);
  for (std::size_t i = 0; i < samples.size(); ++i) {
    CHECK((samples[i].stamp - samples.front().stamp).ns == static_cast<std::int64_t>(i) * kPeriodNs);
    CHECK(samples[i].angular_velocity[2] == Approx((samples[i].stamp - start).seconds()));
  }
  CHECK(imu.stats().gaps == 0);
  receive(now_ns);
  receive(now_ns - 1);
  CHECK(samples.size() == 199);
  CHECK(imu.stats().out_of_order == 2);
  // A gap is not bridged by interpolation.
  receive(now_ns + 100'000'000);
  CHECK(samples.size() == 200);
  CHECK((samples.back().stamp - start).ns == now_ns + 100'000'000);
  CHECK(imu.stats().gaps == 1);
  sample.linear_acceleration[1] = 25.0;
  receive(now_ns + 105'000'000);
  CHECK(imu.stats().saturated == 1);
  CHECK(imu.stats().samples == 201);
}

TEST_CASE("recorded HDL-32E measure gravity upwards", "[hdl32e_imu]") {
  // Stationary and on a highway; the accelerometers' scale is good to 4 %.
  for (const char* name :
       {"velodyne/hdl32e_monterey_stationary.pcap", "velodyne/hdl32e_highway_moving.pcap"}) {
    NILIO_REQUIRE_DATA(capture, name);
    const auto force = mean_motion(capture.string()).linear_acceleration;
    CAPTURE(name, force[0], force[1], force[2]);
    const double size = std::hypot(force[0], force[1], force[2]);
    CHECK(size == Approx(9.81).margin(0.75));
    CHECK(force[2] > 0.98 * size);
  }
}
