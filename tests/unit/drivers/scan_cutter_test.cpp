#include "drivers/velodyne/scan_cutter.hpp"

#include <vector>

#include <catch2/catch.hpp>

using nilio::drivers::ScanCutter;
using Action = ScanCutter::Action;

namespace {

constexpr std::int64_t kPeriodNs = 100'000;
constexpr std::int64_t kLongestNs = 300'000'000;

/// Feeds steps of 1 degree every 0.1 ms and executes the actions of the cutter.
struct Driver {
  ScanCutter cutter{18000, kLongestNs};
  std::int64_t time_ns = 0;

  Action step(int azimuth_deg, bool room = true, bool may_cut = true) {
    time_ns += kPeriodNs;
    const Action action = cutter.evaluate(static_cast<std::uint16_t>(azimuth_deg % 360 * 100), time_ns,
                                          100.0F, kPeriodNs, room, may_cut);
    if (action != Action::kAppend) cutter.open();
    return action;
  }
};

}  // namespace

TEST_CASE("the first step opens a scan wherever it is", "[scan_cutter]") {
  for (const int azimuth : {0, 90, 180, 181, 359}) {
    Driver driver;
    CHECK(driver.cutter.state() == ScanCutter::State::kEmpty);
    CHECK(driver.step(azimuth) == Action::kOpen);
    CHECK(driver.cutter.state() == ScanCutter::State::kFilling);
    CHECK(driver.cutter.start_ns() == driver.time_ns);
  }
}

TEST_CASE("a scan is cut only at the first step after the cut azimuth", "[scan_cutter]") {
  Driver driver;
  std::vector<int> cuts;
  for (int azimuth = 100; azimuth < 100 + 3 * 360; ++azimuth) {
    if (driver.step(azimuth) == Action::kCutAtAzimuth) cuts.push_back(azimuth % 360);
  }
  CHECK(cuts == std::vector<int>{180, 180, 180});
}

TEST_CASE("an azimuth that jitters back across the cut does not cut twice", "[scan_cutter]") {
  Driver driver;
  for (int azimuth = 170; azimuth < 180; ++azimuth) driver.step(azimuth);
  CHECK(driver.step(180) == Action::kCutAtAzimuth);
  // 0.5 degree back and forward again.
  driver.time_ns += kPeriodNs;
  CHECK(driver.cutter.evaluate(17950, driver.time_ns, 100.0F, kPeriodNs, true, true) == Action::kAppend);
  CHECK(driver.step(181) == Action::kAppend);
}

TEST_CASE("a cut waits until the previous scan was taken", "[scan_cutter]") {
  Driver driver;
  for (int azimuth = 170; azimuth < 180; ++azimuth) driver.step(azimuth);
  CHECK(driver.step(180, true, false) == Action::kAppend);
  CHECK(driver.step(181, true, true) == Action::kCutAtAzimuth);
}

TEST_CASE("a scan whose next step passes the cut may end early, and is not cut again", "[scan_cutter]") {
  Driver driver;
  for (int azimuth = 100; azimuth < 179; ++azimuth) {
    driver.step(azimuth);
    CHECK_FALSE(driver.cutter.next_step_cuts(100.0F));
  }
  driver.step(179);
  CHECK(driver.cutter.next_step_cuts(100.0F));
  CHECK_FALSE(driver.cutter.next_step_cuts(99.0F));
  driver.cutter.end_early();
  CHECK_FALSE(driver.cutter.next_step_cuts(100.0F));
  // The sensor turned less than predicted: the step belongs to the next scan nevertheless.
  driver.time_ns += kPeriodNs;
  CHECK(driver.cutter.evaluate(17990, driver.time_ns, 100.0F, kPeriodNs, true, true) == Action::kOpen);
  driver.cutter.open();
  std::vector<int> cuts;
  for (int azimuth = 180; azimuth < 180 + 2 * 360; ++azimuth) {
    if (driver.step(azimuth) != Action::kAppend) cuts.push_back(azimuth);
  }
  CHECK(cuts == std::vector<int>{180 + 360});
}

TEST_CASE("a stopped motor is cut by time", "[scan_cutter]") {
  Driver driver;
  std::vector<std::int64_t> starts;
  for (int i = 0; i < 10'000; ++i) {
    driver.time_ns += kPeriodNs;
    const Action action = driver.cutter.evaluate(4500, driver.time_ns, 0.0F, kPeriodNs, true, true);
    if (action != Action::kAppend) {
      driver.cutter.open();
      starts.push_back(driver.time_ns);
    }
    CHECK((action == Action::kAppend || action == Action::kOpen || action == Action::kCutByTime));
  }
  REQUIRE(starts.size() == 4);
  CHECK(starts[1] - starts[0] == kLongestNs + kPeriodNs);
  CHECK(driver.cutter.revolutions_per_minute() == 0.0);
}

TEST_CASE("a full scan is cut when its buffer is full", "[scan_cutter]") {
  Driver driver;
  driver.step(10);
  CHECK(driver.step(11, false) == Action::kCutByRoom);
}

TEST_CASE("a gap of slightly more than one revolution is cut once, by time and rate", "[scan_cutter]") {
  Driver driver;
  for (int azimuth = 200; azimuth < 300; ++azimuth) driver.step(azimuth);
  driver.time_ns += 400 * kPeriodNs;
  CHECK(driver.step(300 + 400) == Action::kCutAtAzimuth);
}

TEST_CASE("a restart clears the previous scan", "[scan_cutter]") {
  Driver driver;
  for (int azimuth = 200; azimuth < 300; ++azimuth) driver.step(azimuth);
  driver.cutter.restart();
  CHECK(driver.cutter.state() == ScanCutter::State::kEmpty);
  CHECK_FALSE(driver.cutter.has_azimuth());
  CHECK(driver.step(20) == Action::kOpen);
}
