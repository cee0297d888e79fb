#include "daemon/odometry/odometry_loop.hpp"

#include "tests/support/synthetic_room.hpp"

#include <atomic>
#include <cstdint>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::daemon;

/// Feeds scans that are there.
class GivenScans : public ScanFeed {
 public:
  explicit GivenScans(std::vector<core::Scan> scans) : scans_(std::move(scans)) {}

  FeedState next(core::Scan& scan, core::Duration) override {
    if (taken_ == scans_.size()) return FeedState::kEnd;
    scan = scans_[taken_++];
    return FeedState::kScan;
  }

 private:
  std::vector<core::Scan> scans_;
  std::size_t taken_ = 0;
};

core::SE3 stationary(double) { return {}; }

}  // namespace

TEST_CASE("the scan behind superseded ones takes over how clocks were set", "[odometry_loop]") {
  const core::Duration step = core::Duration::from_seconds(3600.0);
  const core::Duration back = core::Duration::from_seconds(0.5);
  std::vector<core::Scan> scans;
  std::vector<ScanDecision> decisions;
  for (std::uint64_t i = 0; i < 6; ++i) {
    scans.push_back(
        tests::scan_room(tests::Room::with_pillars(), stationary, 0.1 * static_cast<double>(i), i));
    decisions.push_back({i, i == 2 || i == 3, false, 0, {}, {}});
  }
  scans[2].after_time_jump = true;
  scans[2].clock_step = step;
  scans[3].clock_step = back;

  std::vector<core::Scan> registered;
  OdometryOutputs outputs;
  outputs.observer = [&](const core::Scan& scan, const core::OdometryResult&, const core::Odometry&) {
    registered.push_back(scan);
  };
  OdometryLoopConfig config;
  config.decisions = &decisions;
  GivenScans feed(std::move(scans));
  core::Result<ipc::WakeEvent> event = ipc::WakeEvent::create();
  REQUIRE(event.ok());
  OdometryLoop loop(core::Odometry(core::OdometryConfig{}), feed, nullptr, *event, nullptr, outputs, config);
  OdometryCounters counters;
  const std::atomic<bool> stop{false};
  while (loop.run(stop, counters)) {
  }

  CHECK(counters.superseded == 2);
  REQUIRE(registered.size() == 4);
  for (const core::Scan& scan : registered) {
    INFO(scan.sequence);
    CHECK(scan.after_time_jump == (scan.sequence == 4));
    CHECK(scan.clock_step == (scan.sequence == 4 ? step + back : core::Duration{}));
  }
}
