#include "nilio/core/units.hpp"
#include "nilio/drivers/common/nearest_name.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/imu_support.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;
using Catch::Matchers::Contains;

namespace {

const std::vector<std::uint8_t> kXsensRate{0x01, 0x00, 0xFF, 0x80, 0x02, 0x00};
const std::vector<std::uint8_t> kXsensAcceleration{0x00, 0x00, 0x00, 0x00, 0x09, 0xCF};

CanFrame rate(std::int64_t stamp_ns) { return frame_of(0x32, kXsensRate, stamp_ns); }
CanFrame acceleration(std::int64_t stamp_ns) { return frame_of(0x34, kXsensAcceleration, stamp_ns); }

}  // namespace

TEST_CASE("Xsens frames give SI values, and encoding them gives the same bytes", "[imu]") {
  const ImuPreset preset = preset_of("xsens_mti");
  ImuDecoder decoder = decoder_of(preset);
  CHECK_FALSE(decoder.add(rate(1000)).has_value());
  const auto sample = decoder.add(acceleration(3000));
  REQUIRE(sample.has_value());
  CHECK(sample->stamp.ns == 1000);
  CHECK(sample->angular_velocity == std::array{0.5, -0.25, 1.0});
  CHECK(sample->linear_acceleration == std::array{0.0, 0.0, 9.80859375});
  const std::vector<CanFrame> frames = encode_imu_sample(*sample, preset);
  REQUIRE(frames.size() == 2);
  CHECK(frames[0].id == 0x32);
  CHECK(bytes_of(frames[0]) == kXsensRate);
  CHECK(frames[1].id == 0x34);
  CHECK(bytes_of(frames[1]) == kXsensAcceleration);
  CHECK(frames[1].stamp.ns == 1000);
}

TEST_CASE("OxTS frames are converted to x forward, y left, z up and to radians", "[imu]") {
  const ImuPreset preset = preset_of("oxts_rt3003");
  ImuDecoder decoder = decoder_of(preset);
  const std::vector<std::uint8_t> acceleration_bytes{0x32, 0x00, 0xEC, 0xFF, 0x2B, 0xFC};
  const std::vector<std::uint8_t> rate_bytes{0x96, 0x00, 0xE2, 0xFF, 0xB0, 0x04};
  CHECK_FALSE(decoder.add(frame_of(0x605, acceleration_bytes, 10)).has_value());
  const auto sample = decoder.add(frame_of(0x608, rate_bytes, 20));
  REQUIRE(sample.has_value());
  CHECK(sample->linear_acceleration[0] == Approx(0.5));
  CHECK(sample->linear_acceleration[1] == Approx(0.2));
  CHECK(sample->linear_acceleration[2] == Approx(9.81));
  CHECK(sample->angular_velocity[0] == Approx(1.5 * nilio::kRadiansPerDegree));
  CHECK(sample->angular_velocity[1] == Approx(0.3 * nilio::kRadiansPerDegree));
  CHECK(sample->angular_velocity[2] == Approx(-12.0 * nilio::kRadiansPerDegree));
  const std::vector<CanFrame> frames = encode_imu_sample(*sample, preset);
  REQUIRE(frames.size() == 2);
  CHECK(bytes_of(frames[0]) == rate_bytes);
  CHECK(bytes_of(frames[1]) == acceleration_bytes);
}

TEST_CASE("a lost frame leaves one group incomplete", "[imu]") {
  ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
  decoder.add(rate(0));
  decoder.add(rate(10'000'000));
  CHECK(decoder.stats().incomplete == 1);
  CHECK(decoder.add(acceleration(10'200'000)).has_value());
  CHECK(decoder.stats().samples == 1);
}

TEST_CASE("grouping that slipped by a lost first frame is corrected", "[imu]") {
  ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
  std::vector<std::int64_t> spans;
  std::optional<std::int64_t> pending;
  for (std::int64_t i = 0; i < 40; ++i) {
    const std::int64_t t = i * 10'000'000;
    if (i != 10) decoder.add(rate(t));
    if (const auto sample = decoder.add(acceleration(t + 200'000)))
      spans.push_back(t + 200'000 - sample->stamp.ns);
  }
  REQUIRE(spans.size() > 30);
  CHECK(spans.back() == 200'000);
  CHECK(std::count(spans.begin(), spans.end(), 200'000) >= 34);
  CHECK(decoder.stats().incomplete == 1);
}

TEST_CASE("frames of other devices, short frames and frames back in time give no sample", "[imu]") {
  ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
  CHECK_FALSE(decoder.add(frame_of(0x33, kXsensRate, 0)).has_value());
  CanFrame extended = rate(0);
  extended.extended = true;
  CanFrame remote = rate(0);
  remote.remote = true;
  CanFrame error = rate(0);
  error.error = true;
  for (const CanFrame& frame : {extended, remote, error}) CHECK_FALSE(decoder.add(frame).has_value());
  CHECK(decoder.stats().other_frames == 4);
  CanFrame short_frame = rate(0);
  short_frame.length = 5;
  CHECK_FALSE(decoder.add(short_frame).has_value());
  CHECK(decoder.stats().short_frames == 1);
  decoder.add(rate(1'000'000));
  CHECK(decoder.add(acceleration(1'200'000)).has_value());
  decoder.add(rate(500'000));
  CHECK_FALSE(decoder.add(acceleration(700'000)).has_value());
  CHECK(decoder.stats().out_of_order == 1);
}

TEST_CASE("the error for a missing mapped name gives the nearest one", "[imu]") {
  const ImuPreset preset = preset_of("xsens_mti");
  ImuMapping mapping = preset.mapping;
  mapping.linear_acceleration[1].signal = "accy";
  auto decoder = ImuDecoder::create(mapping, preset.database);
  REQUIRE_FALSE(decoder.ok());
  CHECK_THAT(decoder.error().message, Contains("'accy'") && Contains("linear acceleration y") &&
                                          Contains("did you mean 'accY'") && Contains("xsens_mti.dbc"));
  mapping = preset.mapping;
  mapping.angular_velocity[0].message = "RateOfTurns";
  decoder = ImuDecoder::create(mapping, preset.database);
  REQUIRE_FALSE(decoder.ok());
  CHECK_THAT(decoder.error().message, Contains("did you mean 'RateOfTurn'"));
  CHECK_THAT(imu_preset("xsens").error().message, Contains("xsens_mti"));
}

TEST_CASE("unusable signals are rejected when the decoder is created", "[imu]") {
  const auto database = parse_dbc(
      "BO_ 1 M: 6 X\n SG_ a : 7|16@0- (1,0) [0|0] \"\" X\n SG_ b m1 : 23|16@0- (1,0) [0|0] \"\" X\n"
      " SG_ c : 47|16@0- (1,0) [0|0] \"\" X\n",
      "t.dbc");
  REQUIRE(database.ok());
  ImuMapping mapping{.name = "t", .angular_velocity = {}, .linear_acceleration = {}};
  for (auto* axes : {&mapping.angular_velocity, &mapping.linear_acceleration}) axes->fill({"M", "a", 1.0});
  CHECK(ImuDecoder::create(mapping, *database).ok());
  mapping.angular_velocity[2].signal = "b";
  CHECK_THAT(ImuDecoder::create(mapping, *database).error().message, Contains("no multiplexer"));
  mapping.angular_velocity[2].signal = "c";
  CHECK_THAT(ImuDecoder::create(mapping, *database).error().message, Contains("does not fit"));
  mapping.angular_velocity[2] = {"M", "a", 0.0};
  CHECK_THAT(ImuDecoder::create(mapping, *database).error().message, Contains("scale"));
}

TEST_CASE("the nearest name is found for misspellings and not for unrelated names", "[imu]") {
  const std::vector<std::string> names{"budget_ms", "voxel_size", "port"};
  CHECK(nearest_name("budgetms", names) == "budget_ms");
  CHECK(nearest_name("VOXEL_SIZE", names) == "voxel_size");
  CHECK(nearest_name("prot", names) == "port");
  CHECK_FALSE(nearest_name("deskew", names).has_value());
  CHECK_FALSE(nearest_name("", names).has_value());
  CHECK_FALSE(nearest_name("x", {}).has_value());
  CHECK_THAT(nearest_name_hint("deskew", names), Contains("there are: budget_ms, voxel_size, port"));
}
