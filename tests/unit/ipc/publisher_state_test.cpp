#include "ipc/publisher_state.hpp"

#include "ipc/ring.hpp"
#include "ipc/shared_object.hpp"

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

namespace {

using Catch::Matchers::Contains;
using nilio::core::Time;
using nilio::ipc::PoseRecord;
using nilio::ipc::PublisherState;
using nilio::ipc::SharedObject;
using nilio::ipc::Stage;
using nilio::ipc::TrackingState;

constexpr std::int64_t kMillisecondNs = 1'000'000;

/// Delivered at 50 ms, 2 ms before its deadline; received at 10 ms.
PoseRecord early_pose() {
  PoseRecord record;
  record.state = TrackingState::kTracking;
  record.has_deadline = true;
  record.overshoot_ns = -2 * kMillisecondNs;
  record.stage_ns[static_cast<std::size_t>(Stage::kReceived)] = 10 * kMillisecondNs;
  record.stage_ns[static_cast<std::size_t>(Stage::kDelivered)] = 50 * kMillisecondNs;
  return record;
}

}  // namespace

TEST_CASE("a pose is late if DDS has written it after the deadline, whenever it was delivered",
          "[publisher_state]") {
  PublisherState state;
  state.record(early_pose(), Time{50 * kMillisecondNs}, Time{51 * kMillisecondNs}, true);
  CHECK(state.late_poses() == 0);
  state.record(early_pose(), Time{50 * kMillisecondNs}, Time{90 * kMillisecondNs}, true);
  CHECK(state.poses() == 2);
  CHECK(state.late_poses() == 1);
  CHECK(state.overshoot().snapshot().max() == 38 * kMillisecondNs);
  CHECK(state.received_to_written().snapshot().max() == 80 * kMillisecondNs);

  PoseRecord initialising = early_pose();
  initialising.state = TrackingState::kInitialising;
  state.record(initialising, Time{50 * kMillisecondNs}, Time{90 * kMillisecondNs}, true);
  PoseRecord without_deadline = early_pose();
  without_deadline.has_deadline = false;
  state.record(without_deadline, Time{50 * kMillisecondNs}, Time{90 * kMillisecondNs}, true);
  CHECK(state.late_poses() == 1);
  state.record(early_pose(), Time{50 * kMillisecondNs}, Time{90 * kMillisecondNs}, false);
  CHECK(state.poses() == 4);
  CHECK(state.failed_writes() == 1);
  CHECK(state.late_poses() == 1);

  const auto json = publisher_json(state);
  CHECK(json["late_poses"] == 1);
  CHECK(json["poses"] == 4);
  CHECK(json["overshoot"]["max_us"] == Approx(38'000.0));
  CHECK(json["received_to_written"]["count"] == 4);
  CHECK(json["write"]["count"] == 4);
  CHECK(json["write"]["max_us"] == Approx(40'000.0));
}

TEST_CASE("a second process continues the counters of the first", "[publisher_state]") {
  const auto created = SharedObject<PublisherState>::create();
  REQUIRE(created.ok());
  {
    const auto first = SharedObject<PublisherState>::attach((*created).file_descriptor());
    REQUIRE(first.ok());
    (**first).record(early_pose(), Time{50 * kMillisecondNs}, Time{90 * kMillisecondNs}, true);
    (**first).beat();
  }
  const auto second = SharedObject<PublisherState>::attach((*created).file_descriptor());
  REQUIRE(second.ok());
  (**second).record(early_pose(), Time{50 * kMillisecondNs}, Time{91 * kMillisecondNs}, true);
  CHECK((**created).late_poses() == 2);
  CHECK((**created).heartbeat() == 1);
  CHECK((**created).overshoot().snapshot().count() == 2);
}

TEST_CASE("memory of another kind is refused as a publisher's state", "[publisher_state]") {
  const auto ring = nilio::ipc::Ring<PoseRecord>::in_shared_memory(4);
  REQUIRE(ring.ok());
  const auto attached = SharedObject<PublisherState>::attach((*ring).file_descriptor());
  REQUIRE_FALSE(attached.ok());
  CHECK_THAT(attached.error().message, Contains("not the shared object"));
  CHECK_FALSE(SharedObject<PublisherState>::attach(0).ok());
}
