// The examples of bytes in the devices' descriptions, and the values that the presets decode.

#include "nilio/core/units.hpp"

#include "tests/support/imu_support.hpp"

#include <cmath>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr double kGravity = 9.80665;

double decoded(const ImuPreset& preset, const char* message_name, const char* signal_name,
               const Bytes& data) {
  const DbcMessage* message = preset.database.find(message_name);
  REQUIRE(message != nullptr);
  const DbcSignal* signal = preset.database.find(message_name, signal_name);
  REQUIRE(signal != nullptr);
  const auto value = decode_physical(*message, *signal, data);
  REQUIRE(value.has_value());
  return *value;
}

CanFrame extended(CanFrame frame) {
  frame.extended = true;
  return frame;
}

}  // namespace

TEST_CASE("SBG frames are converted to x forward, y left, z up", "[imu_presets]") {
  const ImuPreset preset = preset_of("sbg_ellipse");
  const Bytes gyro{0x64, 0x00, 0x38, 0xFF, 0x2C, 0x01};
  CHECK(decoded(preset, "ImuGyro", "GyroX", gyro) == Approx(0.1));
  CHECK(decoded(preset, "ImuGyro", "GyroY", gyro) == Approx(-0.2));
  CHECK(decoded(preset, "ImuGyro", "GyroZ", gyro) == Approx(0.3));
  ImuDecoder decoder = decoder_of(preset);
  // 1000 us, every status bit good, 25.5 degrees.
  CHECK_FALSE(decoder.add(frame_of(0x120, {0xE8, 0x03, 0, 0, 0xFF, 0x03, 0xF6, 0x09}, 10)).has_value());
  CHECK_FALSE(decoder.add(frame_of(0x121, {0x32, 0x00, 0xEC, 0xFF, 0x2B, 0xFC}, 20)).has_value());
  const auto sample = decoder.add(frame_of(0x122, gyro, 30));
  REQUIRE(sample.has_value());
  CHECK(sample->stamp.ns == 20);
  CHECK(sample->angular_velocity[0] == Approx(0.1));
  CHECK(sample->angular_velocity[1] == Approx(0.2));
  CHECK(sample->angular_velocity[2] == Approx(-0.3));
  CHECK(sample->linear_acceleration[0] == Approx(0.5));
  CHECK(sample->linear_acceleration[1] == Approx(0.2));
  CHECK(sample->linear_acceleration[2] == Approx(9.81));
  CHECK(decoder.temperature_degc() == Approx(25.5));
  CHECK(decoder.stats().saturated == 0);
}

TEST_CASE("Bosch MM7.10 frames give yaw, roll, pitch and three accelerations, with the sign of roll inverted",
          "[imu_presets]") {
  const ImuPreset preset = preset_of("bosch_mm7_10");
  const Bytes yaw{0xD0, 0x87, 0x00, 0x00, 0x53, 0x8F, 0x00, 0x00};
  CHECK(decoded(preset, "YawRateAy", "YawRate", yaw) == Approx(10.0));
  CHECK(decoded(preset, "YawRateAy", "Ay", yaw) == Approx(0.500018).epsilon(1e-6));
  ImuDecoder decoder = decoder_of(preset);
  decoder.add(frame_of(0x174, yaw, 10));
  decoder.add(frame_of(0x178, {0xD0, 0x87, 0, 0, 0x00, 0x80, 0, 0}, 20));
  const auto sample = decoder.add(frame_of(0x17C, {0x00, 0x80, 0, 0, 0x53, 0x8F, 0, 0}, 30));
  REQUIRE(sample.has_value());
  CHECK(sample->angular_velocity[0] == Approx(-10.0 * nilio::kRadiansPerDegree));
  CHECK(sample->angular_velocity[1] == Approx(0.0).margin(1e-9));
  CHECK(sample->angular_velocity[2] == Approx(10.0 * nilio::kRadiansPerDegree));
  CHECK(sample->linear_acceleration[1] == Approx(0.500018 * kGravity).epsilon(1e-6));
  CHECK(sample->linear_acceleration[2] == Approx(0.500018 * kGravity).epsilon(1e-6));
  CHECK(decoder.temperature_degc() == -50.0);
  decoder.add(frame_of(0x174, {0xD0, 0x87, 0x00, 0xFF, 0x53, 0x8F, 0x01, 0x00}, 40));
  decoder.add(frame_of(0x174, {0xD0, 0x87, 0x00, 0xC9, 0x53, 0x8F, 0x02, 0x00}, 50));
  CHECK(decoder.temperature_degc() == -50.0);
}

TEST_CASE("an IMU without a pitch rate is used with 0 in its place, and reports it", "[imu_presets]") {
  const ImuPreset preset = preset_of("bosch_mm5_10");
  auto decoder = ImuDecoder::create(preset.mapping, preset.database);
  REQUIRE(decoder.ok());
  CHECK(decoder->taken_as_zero() == "angular velocity y");
  const Bytes golden{0xD0, 0x87, 0x00, 0x00, 0x53, 0x8F, 0x00, 0x00};
  for (int i = 0; i < 3; ++i) {
    decoder->add(frame_of(0x70, golden, 10 + 100 * i));
    decoder->add(frame_of(0x80, golden, 20 + 100 * i));
    const auto sample = decoder->add(frame_of(0x576, golden, 30 + 100 * i));
    REQUIRE(sample.has_value());
    CHECK(sample->angular_velocity[1] == 0.0);
    CHECK(sample->angular_velocity[2] == Approx(10.0 * nilio::kRadiansPerDegree));
  }
}

TEST_CASE("a device that lacks another axis is rejected by name, and can be inspected without it",
          "[imu_presets]") {
  const ImuPreset preset = preset_of("bosch_mm5_10");
  ImuMapping lacking = preset.mapping;
  lacking.angular_velocity[0] = {};
  const auto refused = ImuDecoder::create(lacking, preset.database);
  REQUIRE_FALSE(refused.ok());
  CHECK_THAT(refused.error().message, Contains("bosch_mm5_10") && Contains("angular velocity x") &&
                                          Contains("angular velocity y") && !Contains("acceleration z"));
  lacking = preset.mapping;
  lacking.angular_velocity[1] = lacking.angular_velocity[0];
  lacking.linear_acceleration[2] = {};
  CHECK_THAT(ImuDecoder::create(lacking, preset.database).error().message, Contains("acceleration z"));
  CHECK(missing_axes(preset.mapping) == "angular velocity y");
  auto decoder = ImuDecoder::create_partial(preset.mapping, preset.database);
  REQUIRE(decoder.ok());
  const Bytes golden{0xD0, 0x87, 0x00, 0x00, 0x53, 0x8F, 0x00, 0x00};
  CHECK_FALSE(decoder->add(frame_of(0x70, golden, 10)).has_value());
  CHECK_FALSE(decoder->add(frame_of(0x80, golden, 20)).has_value());
  const auto sample = decoder->add(frame_of(0x576, golden, 30));
  REQUIRE(sample.has_value());
  CHECK(std::isnan(sample->angular_velocity[1]));
  CHECK(sample->angular_velocity[0] == Approx(10.0 * nilio::kRadiansPerDegree));
  CHECK(sample->angular_velocity[2] == Approx(10.0 * nilio::kRadiansPerDegree));
  for (const double value : sample->linear_acceleration) {
    CHECK(value == Approx(0.500018 * kGravity).epsilon(1e-6));
  }
  ImuMapping empty = preset.mapping;
  empty.angular_velocity = {};
  empty.linear_acceleration = {};
  CHECK_THAT(ImuDecoder::create_partial(empty, preset.database).error().message, Contains("no axis"));
}

TEST_CASE("Aceinna frames are recognised by their group at any priority and source", "[imu_presets]") {
  const ImuPreset preset = preset_of("aceinna_openimu");
  const Bytes rates{0x00, 0x82, 0x00, 0x7D, 0x00, 0x7D, 0, 0};
  const Bytes accelerations{0x00, 0x7D, 0x00, 0x7D, 0xD5, 0x80, 0, 0};
  CHECK(decoded(preset, "AngularRate", "RateX", rates) == 10.0);
  CHECK(decoded(preset, "AccelerationSensor", "AccelZ", accelerations) == Approx(9.81));
  for (const auto& [rate_id, acceleration_id] :
       {std::pair{0x0CF02A80U, 0x08F02D80U}, std::pair{0x18F02AE2U, 0x08F02DE2U}}) {
    CAPTURE(rate_id);
    ImuDecoder decoder = decoder_of(preset);
    CHECK_FALSE(decoder.add(extended(frame_of(rate_id, rates, 10))).has_value());
    const auto sample = decoder.add(extended(frame_of(acceleration_id, accelerations, 20)));
    REQUIRE(sample.has_value());
    CHECK(sample->angular_velocity[0] == Approx(10.0 * nilio::kRadiansPerDegree));
    CHECK(sample->linear_acceleration[2] == Approx(-9.81));
    // An 11-bit identifier with the same bits, another group and another format do not match.
    decoder.add(frame_of(rate_id & 0x7FF, rates, 30));
    decoder.add(extended(frame_of(0x0CF02980, rates, 40)));
    decoder.add(extended(frame_of(0x0DF02A80, rates, 50)));
    CHECK(decoder.stats().other_frames == 3);
  }
}

TEST_CASE("of two J1939 devices the configured one is used, or the first until it is silent",
          "[imu_presets]") {
  ImuPreset preset = preset_of("aceinna_openimu");
  const core::ImuSample still{{0}, {}, {0.0, 0.0, 9.81}};
  const auto frames = [&](std::uint8_t source, std::int64_t stamp_ns) {
    std::vector<CanFrame> result = encode_imu_sample(still, preset);
    for (CanFrame& frame : result) {
      frame.id = (frame.id & ~0xFFU) | source;
      frame.stamp.ns = stamp_ns;
    }
    return result;
  };
  ImuDecoder first = decoder_of(preset);
  for (const CanFrame& frame : frames(0x80, 1'000'000)) first.add(frame);
  for (const CanFrame& frame : frames(0xE2, 5'000'000)) first.add(frame);
  CHECK(first.stats().samples == 1);
  CHECK(first.stats().other_sources == 2);
  for (const CanFrame& frame : frames(0xE2, 1'100'000'000)) first.add(frame);
  CHECK(first.stats().samples == 2);
  preset.mapping.source_address = 0xE2;
  ImuDecoder wanted = decoder_of(preset);
  for (const CanFrame& frame : frames(0x80, 1'000'000)) wanted.add(frame);
  CHECK(wanted.stats().other_sources == 2);
  for (const CanFrame& frame : frames(0xE2, 5'000'000)) wanted.add(frame);
  CHECK(wanted.stats().samples == 1);
  CHECK((encode_imu_sample(still, preset)[0].id & 0xFFU) == 0xE2);
}

TEST_CASE("J1939 codes for error and not available are not measurements", "[imu_presets]") {
  ImuDecoder decoder = decoder_of(preset_of("aceinna_openimu"));
  const Bytes good{0x00, 0x7D, 0x00, 0x7D, 0xD5, 0x80, 0, 0};
  std::int64_t stamp = 0;
  for (const Bytes& rates :
       {Bytes{0xFF, 0xFF, 0x00, 0x7D, 0x00, 0x7D, 0, 0}, Bytes{0x00, 0x7D, 0x00, 0xFE, 0x00, 0x7D, 0, 0}}) {
    decoder.add(extended(frame_of(0x0CF02A80, rates, stamp += 10)));
    CHECK_FALSE(decoder.add(extended(frame_of(0x08F02D80, good, stamp += 10))).has_value());
  }
  CHECK(decoder.stats().invalid == 2);
  decoder.add(extended(frame_of(0x0CF02A80, {0xFF, 0xFD, 0x00, 0x7D, 0x00, 0x7D, 0, 0}, stamp += 10)));
  CHECK(decoder.add(extended(frame_of(0x08F02D80, good, stamp += 10))).has_value());
}

TEST_CASE("encoding and decoding are inverse for every preset, to its resolution", "[imu_presets]") {
  REQUIRE(imu_preset_names().size() == 6);
  for (const std::string& name : imu_preset_names()) {
    CAPTURE(name);
    const ImuPreset preset = preset_of(name);
    CHECK(preset.database.notes.empty());
    auto decoder = ImuDecoder::create_partial(preset.mapping, preset.database);
    REQUIRE(decoder.ok());
    core::ImuSample sample{{1'000'000'000}, {0.5, -0.25, 1.0}, {1.0, -2.0, 9.81}};
    for (int i = 0; i < 40; ++i) {
      sample.stamp.ns += 10'000'000;
      std::optional<core::ImuSample> again;
      for (const CanFrame& frame : encode_imu_sample(sample, preset)) again = decoder->add(frame);
      REQUIRE(again.has_value());
      CHECK(again->stamp == sample.stamp);
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (!preset.mapping.angular_velocity[axis].message.empty()) {
          CHECK(again->angular_velocity[axis] == Approx(sample.angular_velocity[axis]).margin(0.002));
        }
        CHECK(again->linear_acceleration[axis] == Approx(sample.linear_acceleration[axis]).margin(0.006));
      }
    }
    CHECK(decoder->stats().samples == 40);
    CHECK(decoder->stats().lost_samples == 0);
    CHECK(decoder->stats().gaps == 0);
  }
}
