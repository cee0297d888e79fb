#include "daemon/config/schema.hpp"
#include "daemon/input/input.hpp"
#include "tests/support/room_drive.hpp"

#include <array>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;

namespace {

std::vector<core::ImuSample> samples_with(const std::string& folder, const std::string& yaml) {
  const auto files = find_replay_files({folder});
  REQUIRE(files.ok());
  Config config;
  REQUIRE(apply_yaml(config, yaml, "test").ok());
  auto input = open_replay(*files, config);
  REQUIRE(input.ok());
  std::vector<core::ImuSample> samples;
  std::array<drivers::CanFrame, 64> frames{};
  for (;;) {
    const drivers::SourceRead read = input->frames->read(frames, core::Duration{});
    for (std::size_t i = 0; i < read.count; ++i) {
      if (const auto sample = input->imu_decoder->add(frames[i])) samples.push_back(*sample);
    }
    if (read.state != drivers::SourceState::kData) return samples;
  }
}

}  // namespace

TEST_CASE("configured scales and time offset are applied on top of the preset", "[imu_scales]") {
  const tests::TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 0.3, true);
  const auto plain = samples_with(folder.path().string(), "imu: {preset: xsens_mti}\n");
  const auto changed = samples_with(folder.path().string(),
                                    "imu:\n  time_offset_ms: 12.5\n  angular_velocity_z: {scale: -2}\n"
                                    "  linear_acceleration_x: {scale: 0.5}\n");
  REQUIRE(plain.size() > 50);
  REQUIRE(changed.size() == plain.size());
  for (std::size_t i = 0; i < plain.size(); ++i) {
    CHECK(changed[i].stamp == plain[i].stamp - core::Duration::from_milliseconds(12.5));
    CHECK(changed[i].angular_velocity[2] == -2.0 * plain[i].angular_velocity[2]);
    CHECK(changed[i].angular_velocity[1] == plain[i].angular_velocity[1]);
    CHECK(changed[i].linear_acceleration[0] == 0.5 * plain[i].linear_acceleration[0]);
  }
}
