#include "daemon/output/can_watch.hpp"

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
