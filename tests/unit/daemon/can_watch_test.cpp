#include "daemon/supervision/can_watch.hpp"

#include "tests/support/imu_support.hpp"

#include <linux/can/error.h>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using Catch::Matchers::Contains;
using drivers::CanBusState;

namespace {

constexpr std::int64_t kSecondNs = 1'000'000'000;

drivers::CanFrame frame_of(std::uint32_t id, bool error = false) {
  drivers::CanFrame frame;
  frame.id = id;
  frame.error = error;
  return frame;
}

}  // namespace

TEST_CASE("a silent IMU is reported once, with the other traffic on the bus", "[can_watch]") {
  const auto traffic = std::make_shared<CanTraffic>();
  ImuSilence silence(traffic, "0x32, 0x34");
  const auto at = [&](double seconds) {
    return silence.observe(kSecondNs + static_cast<std::int64_t>(seconds * 1e9), CanBusState::kErrorPassive);
  };
  CHECK(at(0.0).empty());
  for (int i = 1; i <= 20; ++i) {
    traffic->count(frame_of(0x32), true);
    CHECK(at(i * 0.1).empty());
  }
  for (int i = 0; i < 30; ++i) traffic->count(frame_of(0x123), false);
  traffic->count(frame_of(0x456), false);
  traffic->count(frame_of(CAN_ERR_ACK | CAN_ERR_BUSERROR, true), false);
  CHECK(at(2.9).empty());
  const auto events = at(3.1);
  REQUIRE(events.size() == 1);
  CHECK(events[0].problem);
  CHECK_THAT(events[0].message, Contains("no frame with 0x32, 0x34 for 1.1 s") && Contains("error-passive") &&
                                    Contains("31 frames of other identifiers (0x123, 0x456)") &&
                                    Contains("1 error frames (no acknowledgement, bus errors)"));
  CHECK(at(100.0).empty());
  traffic->count(frame_of(0x32), true);
  const auto back = at(101.0);
  REQUIRE(back.size() == 1);
  CHECK_FALSE(back[0].problem);
  CHECK_THAT(back[0].message, Contains("again after 99.0 s"));
  CHECK(silence.silences() == 1);
}

TEST_CASE("an empty bus is reported, also if no IMU frame was ever received", "[can_watch]") {
  ImuSilence silence(std::make_shared<CanTraffic>(), "0x32");
  CHECK(silence.observe(0, CanBusState::kGone).empty());
  const auto events = silence.observe(kSecondNs, CanBusState::kGone);
  REQUIRE(events.size() == 1);
  CHECK_THAT(events[0].message, Contains("the bus is gone") && Contains("no other frames on the bus"));
}

TEST_CASE("all other identifiers are counted and the first ones are listed", "[can_watch]") {
  const auto traffic = std::make_shared<CanTraffic>();
  for (std::uint32_t id = 0; id < 100; ++id) traffic->count(frame_of(id), false);
  ImuSilence silence(traffic, "0x32");
  silence.observe(0, CanBusState::kUp);
  for (std::uint32_t id = 0; id < 100; ++id) traffic->count(frame_of(id), false);
  const auto events = silence.observe(2 * kSecondNs, CanBusState::kUp);
  REQUIRE(events.size() == 1);
  CHECK_THAT(events[0].message,
             Contains("100 frames of other identifiers (0x0, 0x1, 0x2, 0x3, 0x4, 0x5, ...)"));
}

TEST_CASE("an identified IMU is reported once with its evidence", "[can_watch]") {
  const auto traffic = std::make_shared<CanTraffic>();
  drivers::ImuIdentification identification(drivers::imu_candidates());
  ImuRecognition recognition(traffic, "can0", &identification);
  CHECK_FALSE(recognition.observe(0).has_value());
  for (int i = 0; i < 110; ++i) {
    const core::ImuSample sample{
        core::Time{std::int64_t{1700} * kSecondNs + i * 10'000'000LL}, {0.0, 0.0, 0.0}, {0.0, 0.0, 9.81}};
    for (const auto& frame : drivers::encode_imu_sample(sample, tests::preset_of("oxts_rt3003"))) {
      traffic->count(frame, true);
      if (identification.result() == nullptr) identification.add(frame);
    }
  }
  const auto line = recognition.observe(kSecondNs);
  REQUIRE(line.has_value());
  CHECK(line->level == LogLevel::kInfo);
  CHECK_THAT(line->text, Contains("IMU oxts_rt3003 on CAN can0 identified by frames 0x608, 0x605") &&
                             Contains("specific force 9.81 m/s^2"));
  CHECK_FALSE(recognition.observe(10 * kSecondNs).has_value());
}

TEST_CASE("a bus whose frames are of no known IMU is one error that names the command to inspect it",
          "[can_watch]") {
  const drivers::ImuIdentification identification(drivers::imu_candidates());
  for (const auto* searched : {&identification, static_cast<const drivers::ImuIdentification*>(nullptr)}) {
    const auto traffic = std::make_shared<CanTraffic>();
    ImuRecognition recognition(traffic, "can0", searched);
    // A silent bus is another message.
    CHECK_FALSE(recognition.observe(0).has_value());
    CHECK_FALSE(recognition.observe(60 * kSecondNs).has_value());
    traffic->count(frame_of(0x123), false);
    CHECK_FALSE(recognition.observe(61 * kSecondNs).has_value());
    const auto line = recognition.observe(64 * kSecondNs);
    REQUIRE(line.has_value());
    CHECK(line->level == LogLevel::kError);
    CHECK_THAT(line->text, Contains("nilio inspect FOLDER --write-config") && Contains("1 frames on can0"));
    CHECK_FALSE(recognition.observe(70 * kSecondNs).has_value());
  }
}
