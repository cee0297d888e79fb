// Faults between an IMU and the decoder, and their counters.

#include "tests/support/imu_support.hpp"

#include <cmath>
#include <random>

using namespace nilio;
using namespace nilio::drivers;
using namespace nilio::tests;

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kPeriodNs = 10'000'000;
constexpr std::int64_t kStartNs = 1'700'000'000'000'000'000;

/// Frames of an MM7.10's sample.
std::vector<CanFrame> bosch(std::uint64_t number, std::int64_t stamp_ns) {
  static const ImuPreset preset = preset_of("bosch_mm7_10");
  const double rate = 0.1 * std::sin(static_cast<double>(number));
  const core::ImuSample sample{{stamp_ns}, {rate, 0.0, -rate}, {0.0, 0.0, 9.81}};
  std::vector<CanFrame> frames = encode_imu_sample(sample, preset, number);
  for (std::size_t i = 0; i < frames.size(); ++i)
    frames[i].stamp.ns += static_cast<std::int64_t>(i) * 250'000;
  return frames;
}

/// An SBG Ellipse with a random clock offset and a clock that is fast by `drift`.
struct Ellipse {
  double drift = 0.0;
  std::uint64_t first_us = 4'294'000'000;
  std::int64_t start_ns = kStartNs;
  std::int64_t period_ns = 5'000'000;

  [[nodiscard]] std::int64_t time_ns(int index) const { return start_ns + index * period_ns; }
  [[nodiscard]] std::uint32_t ticks(int index) const {
    const double elapsed_us = static_cast<double>(time_ns(index) - kStartNs) * 1e-3 * (1.0 + drift);
    return static_cast<std::uint32_t>(first_us + static_cast<std::uint64_t>(elapsed_us));
  }
  /// Received `delay_ns` late.
  [[nodiscard]] std::vector<CanFrame> frames(int index, std::int64_t delay_ns,
                                             std::uint16_t status = 0x3FF) const {
    Bytes info = little_endian(ticks(index), 4);
    for (const std::uint8_t byte : little_endian(status, 2)) info.push_back(byte);
    info.insert(info.end(), {0, 0});
    const std::int64_t stamp = time_ns(index) + delay_ns;
    return {frame_of(0x120, info, stamp), frame_of(0x121, {0, 0, 0, 0, 0x2B, 0xFC}, stamp + 200'000),
            frame_of(0x122, little_endian(static_cast<std::uint64_t>(index % 1000), 6), stamp + 400'000)};
  }
};

std::optional<core::ImuSample> feed(ImuDecoder& decoder, const std::vector<CanFrame>& frames) {
  std::optional<core::ImuSample> sample;
  for (const CanFrame& frame : frames) {
    if (const auto result = decoder.add(frame)) sample = result;
  }
  return sample;
}

}  // namespace

TEST_CASE("frames are grouped by their counter whichever frame is lost", "[imu_faults]") {
  for (std::size_t lost = 0; lost < 3; ++lost) {
    CAPTURE(lost);
    ImuDecoder decoder = decoder_of(preset_of("bosch_mm7_10"));
    std::size_t samples = 0;
    for (std::uint64_t n = 0; n < 100; ++n) {
      std::vector<CanFrame> frames = bosch(n, kStartNs + static_cast<std::int64_t>(n) * kPeriodNs);
      if (n % 10 == 7) frames.erase(frames.begin() + static_cast<std::ptrdiff_t>(lost));
      const auto sample = feed(decoder, frames);
      CHECK(sample.has_value() == (n % 10 != 7));
      if (!sample) continue;
      ++samples;
      CHECK(sample->angular_velocity[2] == Approx(-0.1 * std::sin(static_cast<double>(n))).margin(1e-4));
      CHECK(sample->stamp.ns == kStartNs + static_cast<std::int64_t>(n) * kPeriodNs);
    }
    CHECK(samples == 90);
    CHECK(decoder.stats().incomplete == 10);
    CHECK(decoder.stats().lost_samples == 10);
    CHECK(decoder.stats().gaps == 10);
    CHECK(decoder.stats().longest_gap.ns == 2 * kPeriodNs);
  }
}

TEST_CASE("missing samples are counted by the counter across its wrap", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("bosch_mm7_10"));
  for (std::uint64_t n = 0; n < 64; ++n) {
    if (n == 15 || n == 16 || n == 40) continue;
    feed(decoder, bosch(n, kStartNs + static_cast<std::int64_t>(n) * kPeriodNs));
  }
  CHECK(decoder.stats().samples == 61);
  CHECK(decoder.stats().lost_samples == 3);
  CHECK(decoder.stats().incomplete == 0);
  CHECK(decoder.stats().gaps == 2);
  CHECK(decoder.stats().longest_gap.ns == 3 * kPeriodNs);
}

TEST_CASE("samples whose counter does not advance are dropped as repeated", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("bosch_mm7_10"));
  for (std::int64_t i = 0; i < 30; ++i) {
    const std::uint64_t number = i < 10 ? static_cast<std::uint64_t>(i) : 9;
    feed(decoder, bosch(number, kStartNs + i * kPeriodNs));
  }
  CHECK(decoder.stats().samples == 10);
  CHECK(decoder.stats().repeated == 20);
  CHECK(decoder.stats().lost_samples == 0);
}

TEST_CASE("samples with a bad status are dropped and counted", "[imu_faults]") {
  for (const std::size_t byte : {std::size_t{2}, std::size_t{6}}) {
    for (std::size_t message = 0; message < 3; ++message) {
      for (const std::uint8_t fault : Bytes{1, 2, 4, 8}) {
        ImuDecoder decoder = decoder_of(preset_of("bosch_mm7_10"));
        std::vector<CanFrame> frames = bosch(3, kStartNs);
        frames[message].data[byte] |= static_cast<std::uint8_t>(fault << 4);
        // Bit 3 is not a fault.
        CHECK(feed(decoder, frames).has_value() == (fault == 8));
        CHECK(decoder.stats().bad_status == (fault == 8 ? 0 : 1));
        CHECK(feed(decoder, bosch(4, kStartNs + kPeriodNs)).has_value());
        CHECK(decoder.stats().lost_samples == 0);
      }
    }
  }
  ImuDecoder ellipse = decoder_of(preset_of("sbg_ellipse"));
  const Ellipse device;
  CHECK_FALSE(feed(ellipse, device.frames(0, 0, 0x3FB)).has_value());
  CHECK(feed(ellipse, device.frames(1, 0, 0x2FF)).has_value());
  CHECK(ellipse.stats().bad_status == 1);
  CHECK(ellipse.stats().saturated == 1);
}

TEST_CASE("values at the limit of their bits or of the device are counted and kept", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
  const Bytes still{0, 0, 0, 0, 0x09, 0xCF};
  std::int64_t stamp = kStartNs;
  const auto sample = [&](const Bytes& rate, const Bytes& acceleration) {
    decoder.add(frame_of(0x32, rate, stamp += kPeriodNs));
    return decoder.add(frame_of(0x34, acceleration, stamp + 200'000)).has_value();
  };
  // 34.99 rad/s, 35 rad/s, and both limits of the bits.
  CHECK(sample({0, 0, 0, 0, 0x45, 0xFF}, still));
  CHECK(decoder.stats().saturated == 0);
  CHECK(sample({0, 0, 0, 0, 0x46, 0x00}, still));
  CHECK(sample({0x7F, 0xFF, 0, 0, 0, 0}, still));
  CHECK(sample(Bytes(6), {0x80, 0x00, 0, 0, 0, 0}));
  CHECK(decoder.stats().saturated == 3);
  CHECK(decoder.stats().samples == 4);
  // Without a stated range only the limits of the bits count, not one step before them.
  for (const auto& [low_byte, saturated] : {std::pair{0xFF, 1}, std::pair{0xFE, 0}}) {
    ImuDecoder oxts = decoder_of(preset_of("oxts_rt3003"));
    oxts.add(frame_of(0x605, {static_cast<std::uint8_t>(low_byte), 0x7F, 0, 0, 0x2B, 0xFC}, stamp));
    CHECK(oxts.add(frame_of(0x608, Bytes(6), stamp + 1)).has_value());
    CHECK(oxts.stats().saturated == static_cast<std::uint64_t>(saturated));
  }
}

TEST_CASE("constant values are counted from the hundredth sample on, and passed on", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
  for (std::int64_t i = 0; i < 150; ++i) {
    decoder.add(frame_of(0x32, Bytes(6), kStartNs + i * kPeriodNs));
    decoder.add(frame_of(0x34, {0, 0, 0, 0, 0x09, 0xCF}, kStartNs + i * kPeriodNs + 200'000));
  }
  CHECK(decoder.stats().samples == 150);
  CHECK(decoder.stats().frozen == 50);
  CHECK(decoder.stats().repeated == 0);
}

TEST_CASE("a device's clock removes the arrival jitter from the sample times", "[imu_faults]") {
  Ellipse device;
  device.drift = 50e-6;
  ImuDecoder decoder = decoder_of(preset_of("sbg_ellipse"));
  std::mt19937 random(7);
  std::exponential_distribution<double> delay(1.0 / 1e6);
  std::size_t late = 0;
  std::size_t uneven = 0;
  std::size_t settled = 0;
  std::int64_t last = 0;
  for (int i = 0; i < 12'000; ++i) {
    const auto delay_ns = static_cast<std::int64_t>(std::min(delay(random), 4e6));
    const auto sample = feed(decoder, device.frames(i, delay_ns));
    REQUIRE(sample.has_value());
    if (i > 2400) {
      ++settled;
      late += std::abs(sample->stamp.ns - device.time_ns(i)) > 100'000 ? 1 : 0;
      uneven += std::abs(sample->stamp.ns - last - device.period_ns) > 20'000 ? 1 : 0;
    }
    last = sample->stamp.ns;
  }
  // The ticks wrap within the first second.
  CHECK(device.ticks(11'999) < device.ticks(0));
  CHECK(late == 0);
  CHECK(uneven == 0);
  CHECK(settled > 9000);
  CHECK(decoder.stats().samples == 12'000);
  CHECK(decoder.stats().device_stamped > 11'800);
  CHECK(decoder.stats().clock_jumps == 0);
}

TEST_CASE("a smaller arrival delay shifts the sample times gradually", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("sbg_ellipse"));
  const Ellipse device;
  std::size_t uneven = 0;
  std::int64_t last = 0;
  for (int i = 0; i < 3000; ++i) {
    const auto sample = feed(decoder, device.frames(i, i < 400 ? 4'000'000 : 0));
    REQUIRE(sample.has_value());
    const bool by_device = decoder.stats().device_stamped > 1;
    if (by_device && std::abs(sample->stamp.ns - last - device.period_ns) > device.period_ns / 400) ++uneven;
    last = sample->stamp.ns;
  }
  CHECK(uneven == 0);
  CHECK(std::abs(last - device.time_ns(2999)) < 50'000);
}

TEST_CASE("a counter that restarts does not count as lost samples", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
  for (std::int64_t i = 0; i < 40; ++i) {
    const auto counter = static_cast<std::uint64_t>(i < 20 ? 500 + i : i - 20);
    const std::int64_t stamp = kStartNs + i * kPeriodNs;
    feed(decoder, {frame_of(0x06, big_endian(counter, 2), stamp), frame_of(0x32, Bytes(6), stamp + 1),
                   frame_of(0x34, Bytes(6), stamp + 2)});
  }
  CHECK(decoder.stats().samples == 40);
  CHECK(decoder.stats().lost_samples == 0);
}

TEST_CASE("the unit of a device's time is detected from the times of arrival", "[imu_faults]") {
  for (const std::int64_t tick_ns : {1'000, 100'000}) {
    CAPTURE(tick_ns);
    ImuDecoder decoder = decoder_of(preset_of("xsens_mti"));
    std::mt19937 random(1);
    std::size_t exact = 0;
    for (std::int64_t i = 0; i < 2000; ++i) {
      const std::int64_t time = kStartNs + i * kPeriodNs;
      const std::int64_t stamp = time + static_cast<std::int64_t>(random() % 1'000'000);
      const auto ticks = static_cast<std::uint64_t>((time - kStartNs) / tick_ns + 0xFFFFFF00);
      const auto sample =
          feed(decoder,
               {frame_of(0x05, big_endian(ticks, 4), stamp),
                frame_of(0x06, big_endian(static_cast<std::uint64_t>(i + 65'000), 2), stamp + 1),
                frame_of(0x32, Bytes(6), stamp + 2), frame_of(0x34, {0, 0, 0, 0, 0x09, 0xCF}, stamp + 3)});
      REQUIRE(sample.has_value());
      if (i >= 400 && std::abs(sample->stamp.ns - time) < 60'000) ++exact;
    }
    CHECK(exact == 1600);
    CHECK(decoder.stats().device_stamped > 1900);
    CHECK(decoder.stats().lost_samples == 0);
    CHECK(decoder.stats().clock_jumps == 0);
  }
}

TEST_CASE("a device's time that agrees with no unit is not used", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("sbg_ellipse"));
  Ellipse device;
  device.drift = 0.5;
  for (int i = 0; i < 1000; ++i) {
    const auto sample = feed(decoder, device.frames(i, 0));
    REQUIRE(sample.has_value());
    CHECK(sample->stamp.ns == device.time_ns(i) + 200'000);
  }
  CHECK(decoder.stats().device_stamped == 0);
}

TEST_CASE("a device restart and a host clock set back do not break the sample times", "[imu_faults]") {
  Ellipse device;
  ImuDecoder decoder = decoder_of(preset_of("sbg_ellipse"));
  std::int64_t last = 0;
  std::size_t uneven = 0;
  for (int i = 0; i < 4000; ++i) {
    if (i == 1500) device.first_us = 17;
    const std::int64_t delay = i < 2500 ? 0 : -3'600'000'000'000;
    const auto sample = feed(decoder, device.frames(i, delay));
    REQUIRE(sample.has_value());
    // One transition from the first frame's stamp to the device's time.
    const bool first_device_stamp = decoder.stats().device_stamped == 1;
    const std::int64_t step_ns = sample->stamp.ns - last - device.period_ns;
    if (i > 0 && std::abs(step_ns) > (first_device_stamp ? 210'000 : 20'000)) ++uneven;
    last = sample->stamp.ns;
  }
  CHECK(uneven == 0);
  CHECK(std::abs(last - device.time_ns(3999)) < 100'000);
  CHECK(decoder.stats().clock_jumps == 2);
  CHECK(decoder.stats().out_of_order == 0);
}

TEST_CASE("a device's time at the end of a sample is not used for the next one", "[imu_faults]") {
  ImuDecoder decoder = decoder_of(preset_of("sbg_ellipse"));
  const Ellipse device;
  std::size_t right = 0;
  std::size_t samples = 0;
  for (int i = 0; i < 1000; ++i) {
    std::vector<CanFrame> frames = device.frames(i, 0);
    std::rotate(frames.begin(), frames.begin() + 1, frames.end());
    frames[2].stamp.ns = device.time_ns(i) + 600'000;
    const auto sample = feed(decoder, frames);
    if (!sample) continue;
    ++samples;
    if (sample->stamp.ns == device.time_ns(i) + 200'000) ++right;
  }
  CHECK(samples > 990);
  CHECK(right > 980);
}

TEST_CASE("a multiplexed message gives a sample when each part has arrived", "[imu_faults]") {
  const auto database = parse_dbc(
      "BO_ 1 Imu: 8 X\n SG_ part M : 0|8@1+ (1,0) [0|1] \"\" X\n SG_ gx m0 : 8|16@1- (0.01,0) [0|0] \"\" X\n"
      " SG_ gy m0 : 24|16@1- (0.01,0) [0|0] \"\" X\n SG_ gz m0 : 40|16@1- (0.01,0) [0|0] \"\" X\n"
      " SG_ ax m1 : 8|16@1- (0.01,0) [0|0] \"\" X\n SG_ ay m1 : 24|16@1- (0.01,0) [0|0] \"\" X\n"
      " SG_ az m1 : 40|16@1- (0.01,0) [0|0] \"\" X\n",
      "t.dbc");
  REQUIRE(database.ok());
  const ImuMapping mapping{.name = "t",
                           .angular_velocity = {{{"Imu", "gx"}, {"Imu", "gy"}, {"Imu", "gz"}}},
                           .linear_acceleration = {{{"Imu", "ax"}, {"Imu", "ay"}, {"Imu", "az"}}}};
  auto decoder = ImuDecoder::create(mapping, *database);
  REQUIRE(decoder.ok());
  CHECK_FALSE(decoder->add(frame_of(1, {0, 100, 0, 200, 0, 44, 1, 0}, 10)).has_value());
  CHECK_FALSE(decoder->add(frame_of(1, {7, 1, 1, 1, 1, 1, 1, 0}, 20)).has_value());
  const auto sample = decoder->add(frame_of(1, {1, 0, 0, 0, 0, 0xD5, 0x03, 0}, 30));
  REQUIRE(sample.has_value());
  CHECK(sample->angular_velocity[0] == Approx(1.0));
  CHECK(sample->angular_velocity[2] == Approx(3.0));
  CHECK(sample->linear_acceleration[2] == Approx(9.81));
}
