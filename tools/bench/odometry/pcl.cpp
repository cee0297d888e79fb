#include "tools/bench/odometry/measure.hpp"

#ifdef NILIO_WITH_PCL

#include "nilio/core/clock.hpp"

#include <deque>
#include <memory>
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/ndt.h>
#include <utility>

namespace nilio::tools::bench {

namespace {

using core::OdometryResult;
using core::Result;
using core::SE3;
using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Registration = pcl::Registration<pcl::PointXYZ, pcl::PointXYZ>;

// Values of PCL's tutorial on NDT and of hdl_graph_slam.
constexpr float kNdtResolution = 1.0F;
constexpr double kNdtStepMetres = 0.1;
constexpr double kEpsilon = 0.01;
constexpr double kIcpReachMetres = 2.5;
constexpr int kIterations = 35;
constexpr std::size_t kMapScans = 10;
constexpr float kMapVoxelMetres = 0.5F;

std::unique_ptr<Registration> make_ndt() {
  auto ndt = std::make_unique<pcl::NormalDistributionsTransform<pcl::PointXYZ, pcl::PointXYZ>>();
  ndt->setResolution(kNdtResolution);
  ndt->setStepSize(kNdtStepMetres);
  ndt->setTransformationEpsilon(kEpsilon);
  ndt->setMaximumIterations(kIterations);
  return ndt;
}

std::unique_ptr<Registration> make_icp() {
  auto icp = std::make_unique<pcl::IterativeClosestPoint<pcl::PointXYZ, pcl::PointXYZ>>();
  icp->setMaxCorrespondenceDistance(kIcpReachMetres);
  icp->setTransformationEpsilon(kEpsilon * kEpsilon);
  icp->setMaximumIterations(kIterations);
  return icp;
}

Cloud::Ptr to_cloud(const std::vector<Eigen::Vector3f>& points) {
  auto cloud = std::make_shared<Cloud>();
  cloud->reserve(points.size());
  for (const Eigen::Vector3f& p : points) cloud->emplace_back(p.x(), p.y(), p.z());
  return cloud;
}

/// Odometry by one of PCL's registrations, with a constant velocity between scans.
class PclOdometry {
 public:
  PclOdometry(std::string name, std::unique_ptr<Registration> registration, std::size_t map_scans)
      : name_(std::move(name)), registration_(std::move(registration)), map_scans_(map_scans) {}

  /// `T_start` is the motion over the first scan period, for drives that start in motion.
  void add(const Cloud::Ptr& scan, const SE3& T_start) {
    const std::int64_t wall_ns = clock_ns(CLOCK_MONOTONIC);
    const std::int64_t cpu_ns = clock_ns(CLOCK_THREAD_CPUTIME_ID);
    const SE3 T_before = poses_.empty() ? SE3{} : poses_.back();
    SE3 pose = T_before;
    if (poses_.size() == 1) motion_ = T_start;
    if (!poses_.empty()) pose = align(scan, T_before);
    motion_ = T_before.inverse() * pose;
    keep(scan, pose);
    // The first scan has no target to be registered with.
    if (poses_.size() == 1) return;
    wall_ms_.push_back(static_cast<double>(clock_ns(CLOCK_MONOTONIC) - wall_ns) * 1e-6);
    cpu_ms_.push_back(static_cast<double>(clock_ns(CLOCK_THREAD_CPUTIME_ID) - cpu_ns) * 1e-6);
  }

  [[nodiscard]] Measurement measured() const {
    Measurement measurement;
    measurement.name = name_;
    measurement.wall.total = percentiles_of(wall_ms_);
    measurement.wall.per_scan = wall_ms_;
    measurement.cpu.total = percentiles_of(cpu_ms_);
    measurement.cpu.per_scan = cpu_ms_;
    return measurement;
  }
  [[nodiscard]] const std::vector<SE3>& poses() const { return poses_; }

 private:
  struct Keyframe {
    Cloud::Ptr points;
    SE3 pose;
  };

  SE3 align(const Cloud::Ptr& scan, const SE3& T_before) {
    registration_->setInputTarget(make_target());
    registration_->setInputSource(scan);
    const SE3 T_guess = T_before * motion_;
    Cloud aligned;
    registration_->align(aligned, T_guess.matrix().cast<float>());
    const Eigen::Matrix4d found = registration_->getFinalTransformation().cast<double>();
    const SE3 pose = core::se3_from_matrix(found.topRows<3>());
    return pose.is_finite() ? pose : T_guess;
  }

  /// Previous scans in the odometry's frame, downsampled where they are several.
  [[nodiscard]] Cloud::Ptr make_target() const {
    auto sum = std::make_shared<Cloud>();
    for (const Keyframe& keyframe : recent_) {
      for (const pcl::PointXYZ& p : *keyframe.points) {
        const Eigen::Vector3f q =
            (keyframe.pose * core::Vector3(p.getVector3fMap().cast<double>())).cast<float>();
        sum->emplace_back(q.x(), q.y(), q.z());
      }
    }
    if (recent_.size() < 2) return sum;
    auto downsampled = std::make_shared<Cloud>();
    pcl::VoxelGrid<pcl::PointXYZ> grid;
    grid.setLeafSize(kMapVoxelMetres, kMapVoxelMetres, kMapVoxelMetres);
    grid.setInputCloud(sum);
    grid.filter(*downsampled);
    return downsampled;
  }

  void keep(const Cloud::Ptr& scan, const SE3& pose) {
    poses_.push_back(pose);
    recent_.push_back({scan, pose});
    if (recent_.size() > map_scans_) recent_.pop_front();
  }

  std::string name_;
  std::unique_ptr<Registration> registration_;
  std::size_t map_scans_;
  SE3 motion_;
  std::vector<SE3> poses_;
  std::deque<Keyframe> recent_;
  std::vector<double> wall_ms_;
  std::vector<double> cpu_ms_;
};

}  // namespace

Result<std::vector<Measurement>> measure_pcl(const BenchDataset& dataset,
                                             const std::vector<std::string>& overrides) {
  const Result<daemon::Config> config = bench_config(dataset, overrides);
  if (!config) return config.error();
  std::vector<PclOdometry> peers;
  peers.emplace_back("PCL NDT, scan to scan", make_ndt(), 1);
  peers.emplace_back("PCL NDT, scan to map", make_ndt(), kMapScans);
  peers.emplace_back("PCL ICP, scan to scan", make_icp(), 1);
  peers.emplace_back("PCL ICP, scan to map", make_icp(), kMapScans);
  SE3 T_first;
  const auto register_with_peers = [&](const core::Scan&, const OdometryResult& result,
                                       const core::Odometry& odometry) {
    const Cloud::Ptr cloud = to_cloud(odometry.deskewed_points());
    if (peers.front().poses().empty()) T_first = result.T_odom_base;
    for (PclOdometry& peer : peers) peer.add(cloud, T_first.inverse() * result.T_odom_base);
  };
  const Result<BenchRun> run = run_odometry(dataset, *config, nullptr, register_with_peers);
  if (!run) return run.error();
  std::vector<Measurement> measurements;
  for (const PclOdometry& peer : peers) {
    Measurement measurement = peer.measured();
    measurement.trajectory = make_trajectory(dataset, *run, peer.poses());
    const Result<Accuracy> accuracy = measure_accuracy(dataset.truth, measurement.trajectory);
    if (!accuracy) return accuracy.error();
    measurement.accuracy = *accuracy;
    measurements.push_back(std::move(measurement));
  }
  return measurements;
}

}  // namespace nilio::tools::bench

#else

namespace nilio::tools::bench {

core::Result<std::vector<Measurement>> measure_pcl(const BenchDataset& /*dataset*/,
                                                   const std::vector<std::string>& /*overrides*/) {
  return core::Error{
      "--vs pcl: this nilio was built without PCL - install libpcl-dev, run cmake again and rebuild"};
}

}  // namespace nilio::tools::bench

#endif
