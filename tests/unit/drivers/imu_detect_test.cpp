#include "nilio/drivers/imu/detect.hpp"

#include "tests/support/imu_support.hpp"

#include <algorithm>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;

namespace {

/// `count` samples at 100 Hz of an IMU at rest, with this specific force along z.
std::vector<CanFrame> frames_of(const std::string& preset_name, int count, double gravity) {
  const ImuPreset preset = tests::preset_of(preset_name);
  std::vector<CanFrame> frames;
  for (int i = 0; i < count; ++i) {
    const core::ImuSample sample{core::Time{1'700'000'000'000'000'000 + std::int64_t{i} * 10'000'000},
                                 {0.01, -0.02, 0.03},
                                 {0.0, 0.0, gravity}};
    const std::vector<CanFrame> more = encode_imu_sample(sample, preset);
    frames.insert(frames.end(), more.begin(), more.end());
  }
  return frames;
}

class FrameList final : public FrameSource {
 public:
  explicit FrameList(std::vector<CanFrame> frames) : frames_(std::move(frames)) {}
  SourceRead read(std::span<CanFrame> slots, core::Duration /*timeout*/) override {
    const std::size_t count = std::min(slots.size(), frames_.size() - next_);
    std::copy_n(frames_.begin() + static_cast<std::ptrdiff_t>(next_), count, slots.begin());
    next_ += count;
    return {count > 0 ? SourceState::kData : SourceState::kEnd, count};
  }
  [[nodiscard]] SourceStats stats() const override { return {}; }
  [[nodiscard]] std::string status() const override { return {}; }

 private:
  std::vector<CanFrame> frames_;
  std::size_t next_ = 0;
};

/// Number of frames after which the IMU is identified; 0 = it is not.
std::size_t feed(ImuIdentification& identification, const std::vector<CanFrame>& frames) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (identification.add(frames[i])) return i + 1;
  }
  return 0;
}

}  // namespace

TEST_CASE("every built-in IMU of six axes is identified by a second of its frames, and no sample is lost",
          "[imu_detect]") {
  std::size_t checked = 0;
  for (const ImuCandidate& candidate : imu_candidates()) {
    CAPTURE(candidate.preset);
    const std::vector<CanFrame> frames = frames_of(candidate.preset, 150, 9.81);
    ImuIdentification identification(imu_candidates());
    const std::size_t used = feed(identification, frames);
    REQUIRE(used > 0);
    REQUIRE(identification.result() != nullptr);
    CHECK(identification.result()->preset == candidate.preset);
    CHECK(identification.result()->seconds == Approx(1.0).margin(0.02));
    CHECK(identification.result()->text().find("specific force 9.8") != std::string::npos);
    // The decoder continues where the identification ended, as one that had been configured.
    std::vector<core::ImuSample> samples;
    for (const ReceivedSample& received : identification.samples()) samples.push_back(received.sample);
    CHECK(samples.size() == identification.result()->samples);
    ImuDecoder rest = identification.take_decoder();
    for (std::size_t i = used; i < frames.size(); ++i) {
      if (const auto sample = rest.add(frames[i])) samples.push_back(*sample);
    }
    ImuDecoder configured = tests::decoder_of(tests::preset_of(candidate.preset));
    std::vector<core::ImuSample> expected;
    for (const CanFrame& frame : frames) {
      if (const auto sample = configured.add(frame)) expected.push_back(*sample);
    }
    REQUIRE(samples.size() == expected.size());
    for (std::size_t i = 0; i < samples.size(); ++i) {
      CHECK(samples[i].stamp == expected[i].stamp);
      CHECK(samples[i].angular_velocity == expected[i].angular_velocity);
      CHECK(samples[i].linear_acceleration == expected[i].linear_acceleration);
    }
    ++checked;
  }
  CHECK(checked >= 4);
}

TEST_CASE("a recording that ends early or has implausible samples still gives its IMU, marked as such",
          "[imu_detect]") {
  ImuIdentification brief(imu_candidates());
  FrameList some(frames_of("sbg_ellipse", 20, 9.81));
  const IdentifiedImu* const found = brief.identify(some);
  REQUIRE(found != nullptr);
  CHECK(found->preset == "sbg_ellipse");
  CHECK(found->is_plausible());
  ImuIdentification in_g(imu_candidates());
  FrameList wrong_unit(frames_of("xsens_mti", 20, 1.0));
  REQUIRE(in_g.identify(wrong_unit) != nullptr);
  CHECK(in_g.result()->preset == "xsens_mti");
  CHECK_FALSE(in_g.result()->is_plausible());
}

TEST_CASE("another device with the identifiers of an IMU and an empty bus identify none", "[imu_detect]") {
  ImuIdentification other(imu_candidates());
  CHECK(feed(other, frames_of("xsens_mti", 3000, 1.0)) == 0);
  CHECK(other.result() == nullptr);
  ImuIdentification none(imu_candidates());
  FrameList nothing({});
  CHECK(none.identify(nothing) == nullptr);
}

TEST_CASE("samples beyond the buffer of an identification are counted as lost", "[imu_detect]") {
  ImuIdentification identification(imu_candidates());
  REQUIRE(feed(identification, frames_of("xsens_mti", 3000, 1.0)) == 0);
  // The mean becomes plausible after as many samples of 20 m/s^2.
  std::vector<CanFrame> later = frames_of("xsens_mti", 6000, 20.0);
  later.erase(later.begin(), later.begin() + static_cast<std::ptrdiff_t>(later.size() / 2));
  REQUIRE(feed(identification, later) > 0);
  CHECK(identification.samples_lost() + identification.samples().size() == identification.result()->samples);
  CHECK(identification.samples_lost() > 0);
}
