#include "nilio/drivers/imu/detect.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;

namespace {

/// `count` samples at 100 Hz of an IMU at rest, with this specific force along z.
std::vector<CanFrame> frames_of(const std::string& preset_name, int count, double gravity) {
  const core::Result<ImuPreset> preset = imu_preset(preset_name);
  REQUIRE(preset.ok());
  std::vector<CanFrame> frames;
  for (int i = 0; i < count; ++i) {
    const core::ImuSample sample{core::Time{1'700'000'000'000'000'000 + std::int64_t{i} * 10'000'000},
                                 {0.01, -0.02, 0.03},
                                 {0.0, 0.0, gravity}};
    const std::vector<CanFrame> more = encode_imu_sample(sample, *preset);
    frames.insert(frames.end(), more.begin(), more.end());
  }
  return frames;
}

std::optional<std::string> detect(const std::vector<CanFrame>& frames) {
  ImuDetector detector;
  for (const CanFrame& frame : frames) detector.add(frame);
  return detector.preset();
}

}  // namespace

TEST_CASE("every built-in IMU of six axes is detected by its frames", "[imu_detect]") {
  std::size_t checked = 0;
  for (const std::string& name : imu_preset_names()) {
    const core::Result<ImuPreset> preset = imu_preset(name);
    REQUIRE(preset.ok());
    if (!ImuDecoder::create(preset->mapping, preset->database)) continue;
    CAPTURE(name);
    CHECK(detect(frames_of(name, 100, 9.81)) == name);
    ++checked;
  }
  CHECK(checked >= 4);
}

TEST_CASE("another device with the identifiers of an IMU and an empty bus give no preset", "[imu_detect]") {
  CHECK_FALSE(detect(frames_of("xsens_mti", 100, 1.0)).has_value());
  CHECK_FALSE(detect({}).has_value());
}
