#include "ipc/odometry_resets.hpp"

#include <cstddef>
#include <cstdint>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio::ipc;

namespace {

/// Poses at 10 m/s, ten a second.
class Poses {
 public:
  OdometryReset add(TrackingState state, bool predicted = false, double jump_m = 0.0) {
    PoseRecord record;
    position_m_ += 1.0 + jump_m;
    record.stamp_ns = 100'000'000 * count_++;
    record.position[0] = position_m_;
    record.linear_velocity[0] = 10.0;
    record.state = state;
    record.predicted = predicted;
    return detector.add(record);
  }
  void drive(std::size_t count, TrackingState state, bool predicted = false) {
    for (std::size_t i = 0; i < count; ++i) CHECK(add(state, predicted) == OdometryReset::kNone);
  }
  OdometryResetDetector detector;

 private:
  std::int64_t count_ = 0;
  double position_m_ = 0.0;
};

}  // namespace

TEST_CASE("a drive without a loss has no reset", "[odometry_resets]") {
  Poses poses;
  poses.drive(5, TrackingState::kInitialising);
  poses.drive(50, TrackingState::kTracking);
  poses.drive(5, TrackingState::kDegraded);
  poses.drive(1, TrackingState::kDegraded, true);
  poses.drive(5, TrackingState::kTracking);
  CHECK(poses.detector.step_m() == Approx(1.0));
  CHECK(poses.detector.poses_without_tracking() == 0);
}

TEST_CASE("a map reset has the reason that led to it", "[odometry_resets]") {
  Poses poses;
  SECTION("the first scans do not fit together") {
    poses.drive(2, TrackingState::kInitialising);
    poses.drive(1, TrackingState::kInitialising, true);
    CHECK(poses.add(TrackingState::kInitialising) == OdometryReset::kInitialisation);
  }
  SECTION("no scan could be registered") {
    poses.drive(20, TrackingState::kTracking);
    poses.drive(4, TrackingState::kDegraded, true);
    poses.drive(26, TrackingState::kLost, true);
    CHECK(poses.add(TrackingState::kInitialising) == OdometryReset::kNotRegistered);
    CHECK(poses.detector.poses_without_tracking() == 30);
  }
  SECTION("no place of the map was recognised") {
    poses.drive(20, TrackingState::kTracking);
    poses.drive(12, TrackingState::kLost);
    CHECK(poses.add(TrackingState::kInitialising) == OdometryReset::kNotRelocalised);
    CHECK(poses.detector.poses_without_tracking() == 12);
  }
}

TEST_CASE("a relocalised pose is a reset only where the vehicle cannot have driven to it",
          "[odometry_resets]") {
  Poses poses;
  poses.drive(20, TrackingState::kTracking);
  poses.drive(6, TrackingState::kLost, true);
  SECTION("a jump") {
    CHECK(poses.add(TrackingState::kLost, false, 3.0) == OdometryReset::kRelocalised);
    CHECK(poses.detector.step_m() == Approx(4.0));
    CHECK(poses.detector.poses_without_tracking() == 6);
  }
  SECTION("a step") { CHECK(poses.add(TrackingState::kDegraded, false, 0.4) == OdometryReset::kNone); }
}

TEST_CASE("every reset has a name", "[odometry_resets]") {
  CHECK(std::string(name_of(OdometryReset::kNone)) == "none");
  CHECK(std::string(name_of(OdometryReset::kRelocalised)) == "relocalised");
}
