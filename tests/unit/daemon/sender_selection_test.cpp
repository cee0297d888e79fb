#include "daemon/input/sender_selection.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using nilio::daemon::SenderSelection;
using Verdict = SenderSelection::Verdict;

namespace {

constexpr std::uint32_t kSensor = 0xC0A801C9;
constexpr std::uint32_t kOther = 0xC0A8014D;
constexpr std::int64_t kMillisecondNs = 1'000'000;
constexpr std::int64_t kStartNs = 1'700'000'000'000 * kMillisecondNs;

drivers::Packet packet_from(std::uint32_t address, std::int64_t ms,
                            std::size_t size = drivers::kDataPacketSize) {
  drivers::Packet packet;
  packet.sender_address = address;
  packet.stamp.ns = kStartNs + ms * kMillisecondNs;
  packet.size = static_cast<std::uint16_t>(size);
  return packet;
}

/// Sends one data packet per millisecond from `first_ms`; returns the last verdict.
Verdict send(SenderSelection& selection, std::uint32_t address, std::int64_t first_ms, std::int64_t count) {
  Verdict verdict = Verdict::kUndecided;
  for (std::int64_t i = 0; i < count; ++i) verdict = selection.examine(packet_from(address, first_ms + i));
  return verdict;
}

}  // namespace

TEST_CASE("the sender with a sensor's rate is selected, not the one of the first packet",
          "[sender_selection]") {
  SenderSelection selection;
  CHECK(selection.examine(packet_from(kOther, 0)) == Verdict::kUndecided);
  CHECK(send(selection, kSensor, 1, SenderSelection::kSteadyPackets - 1) == Verdict::kUndecided);
  CHECK(send(selection, kSensor, 40, 1) == Verdict::kSelected);
  CHECK(selection.sender() == kSensor);
  CHECK(send(selection, kSensor, 41, 1) == Verdict::kOwn);
  CHECK(selection.examine(packet_from(kOther, 42)) == Verdict::kForeign);
}

TEST_CASE("twenty packets a second select nobody, and lock no sensor out", "[sender_selection]") {
  SenderSelection selection;
  for (std::int64_t ms = 0; ms < 60'000; ms += 50)
    REQUIRE(selection.examine(packet_from(kOther, ms)) == Verdict::kUndecided);
  CHECK(send(selection, kSensor, 60'000, SenderSelection::kSteadyPackets) == Verdict::kSelected);
}

TEST_CASE("a sender with a sensor's rate does not replace a sensor that sends", "[sender_selection]") {
  SenderSelection selection;
  send(selection, kSensor, 0, 100);
  for (std::int64_t ms = 100; ms < 20'000; ms += 2) {
    REQUIRE(selection.examine(packet_from(kSensor, ms)) == Verdict::kOwn);
    for (int i = 0; i < 5; ++i) REQUIRE(selection.examine(packet_from(kOther, ms)) == Verdict::kForeign);
  }
}

TEST_CASE("another sender is selected after three seconds of silence", "[sender_selection]") {
  SenderSelection selection;
  send(selection, kSensor, 0, 100);
  CHECK(send(selection, kOther, 100, 2900) == Verdict::kForeign);
  CHECK(selection.sender() == kSensor);
  Verdict verdict = Verdict::kForeign;
  std::int64_t ms = 3000;
  for (; verdict == Verdict::kForeign && ms < 4000; ++ms) verdict = send(selection, kOther, ms, 1);
  CHECK(verdict == Verdict::kSelected);
  CHECK(selection.sender() == kOther);
  CHECK(ms < 3110);
  SECTION("and back") {
    CHECK(send(selection, kSensor, ms, 100) == Verdict::kForeign);
    CHECK(send(selection, kSensor, ms + 3000, 100) == Verdict::kOwn);
  }
  SECTION("stray packets do not take the place of a silent sensor") {
    for (std::int64_t later = ms; later < ms + 60'000; later += 50)
      REQUIRE(selection.examine(packet_from(kSensor, later)) == Verdict::kForeign);
  }
}

TEST_CASE("steps of the host's clock change no selection", "[sender_selection]") {
  SenderSelection selection;
  send(selection, kSensor, 0, 100);
  const std::int64_t step = GENERATE(3'600'000, -3'600'000);
  for (std::int64_t ms = 100; ms < 1000; ++ms) {
    REQUIRE(selection.examine(packet_from(kOther, step + ms)) == Verdict::kForeign);
    REQUIRE(selection.examine(packet_from(kSensor, step + ms)) == Verdict::kOwn);
  }
  // A replaced sensor is found after the step, too.
  CHECK(send(selection, kOther, step + 1000, 3200) == Verdict::kOwn);
}

TEST_CASE("position packets select nobody", "[sender_selection]") {
  SenderSelection selection;
  for (std::int64_t ms = 0; ms < 100; ++ms)
    REQUIRE(selection.examine(packet_from(kOther, ms, drivers::kPositionPacketSize)) == Verdict::kUndecided);
  send(selection, kSensor, 100, SenderSelection::kSteadyPackets);
  CHECK(selection.examine(packet_from(kOther, 200, drivers::kPositionPacketSize)) == Verdict::kForeign);
  CHECK(selection.examine(packet_from(kSensor, 200, drivers::kPositionPacketSize)) == Verdict::kOwn);
}

TEST_CASE("at the end of a short input the most frequent sender is selected", "[sender_selection]") {
  SenderSelection selection;
  CHECK_FALSE(selection.finish());
  send(selection, kOther, 0, 3);
  send(selection, kSensor, 3, 20);
  CHECK(selection.finish());
  CHECK(selection.sender() == kSensor);
}

TEST_CASE("many senders do not hide a sensor, and each of the first eight is reported once",
          "[sender_selection]") {
  SenderSelection selection;
  for (std::int64_t ms = 0; ms < 100; ++ms) {
    for (std::uint32_t i = 0; i < 3; ++i)
      selection.examine(packet_from(kOther + 1 + static_cast<std::uint32_t>(3 * ms) + i, ms));
    selection.examine(packet_from(kSensor, ms));
  }
  CHECK(selection.sender() == kSensor);
  int reports = 0;
  for (std::uint32_t i = 0; i < 100; ++i) {
    if (selection.is_first_of(kOther + i % 50)) ++reports;
  }
  CHECK(reports == 8);
}
