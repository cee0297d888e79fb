#pragma once

#include "nilio/core/compute_budget.hpp"
#include "nilio/core/odometry.hpp"

#include <functional>
#include <optional>

namespace nilio::core {

/// The part of the odometry's interface that a real-time host needs: start-up of the worker threads,
/// deadlines, and runs that repeat recorded decisions. A view; the odometry must outlive it. Thread-safety as
/// Odometry.
class OdometryRuntime {
 public:
  explicit OdometryRuntime(Odometry& odometry) : odometry_(&odometry) {}

  /// Starts the arena's threads and calls `on_thread`, which must not throw, once in each of them, all at the
  /// same time; waits up to a second. Returns the number of threads reached. Call it before the first scan
  /// from the thread that registers scans: the others are started by it and inherit its scheduling.
  int warm_up(const std::function<void()>& on_thread);
  /// Stamp of the last IMU sample.
  [[nodiscard]] std::optional<Time> latest_imu() const;
  /// Predicted pose of base_link at the end of `scan`, in case its registration misses the deadline.
  [[nodiscard]] OdometryResult predict_pose(const Scan& scan) const;
  /// Registers a scan with the decisions of an earlier run instead of a budget.
  OdometryResult register_scan(const Scan& scan, const BudgetDecisions& decisions);
  /// Call after the pose was published: the time until then counts as the scan's.
  void note_published(const OdometryResult& result);
  [[nodiscard]] const ComputeBudget& budget() const;

 private:
  Odometry* odometry_;
};

}  // namespace nilio::core
