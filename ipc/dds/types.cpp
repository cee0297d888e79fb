#include "ipc/dds/type_support.hpp"

#include <cstddef>
#include <cstdint>
#include <string>

namespace nilio::dds {
namespace {

// Typical lengths for the preallocation of payloads; longer ones cost one reallocation.
constexpr std::size_t kTypicalStages = 16;
constexpr std::size_t kTypicalBuckets = 80;
// Minimum sizes, with empty names.
constexpr std::size_t kSmallestTransform = 8 + 2 * 4 + 7 * 8;
constexpr std::size_t kSmallestBucket = 3 * 8;
constexpr std::size_t kSmallestStage = 4 + 6 * 8 + 4;
constexpr std::size_t kSmallestStamp = 4 + 8;
constexpr std::size_t kSmallestStatus = 1 + 4 * 4;
constexpr std::size_t kSmallestKeyValue = 2 * 4;
constexpr std::size_t kTypicalStatuses = 2;
constexpr std::size_t kTypicalValues = 24;

}  // namespace

template <class Out>
static void put(Out& out, const Odometry& message) {
  put(out, message.stamp);
  out << message.frame_id << message.child_frame_id << message.position << message.orientation_xyzw
      << message.pose_covariance << message.linear_velocity << message.angular_velocity
      << message.twist_covariance;
}

template <class Out>
static void put(Out& out, const TransformMessage& message) {
  out << static_cast<std::uint32_t>(message.transforms.size());
  for (const TransformStamped& transform : message.transforms) {
    put(out, transform.stamp);
    out << transform.frame_id << transform.child_frame_id << transform.translation << transform.rotation_xyzw;
  }
}

template <class Out>
static void put(Out& out, const LatencyReport& message) {
  put(out, message.stamp);
  out << static_cast<std::uint32_t>(message.stages.size());
  for (const StageLatency& stage : message.stages) {
    out << stage.name << stage.count << stage.p50_us << stage.p90_us << stage.p99_us << stage.p99_9_us
        << stage.max_us << static_cast<std::uint32_t>(stage.buckets.size());
    for (const LatencyBucket& bucket : stage.buckets) out << bucket.from_us << bucket.to_us << bucket.count;
  }
  out << message.poses_published << message.failed_writes << message.ring_dropped << message.ring_high_water
      << message.imu_poses_published << message.imu_ring_dropped << message.imu_ring_high_water;
}

template <class Out>
static void put(Out& out, const ScanReport& message) {
  put(out, message.stamp);
  put(out, message.scan_start);
  out << message.sequence << message.state << message.stop_reason;
  put(out, message.delivered);
  out << message.host_id << static_cast<std::uint32_t>(message.stages.size());
  for (const StageStamp& stage : message.stages) out << stage.name << stage.monotonic_ns;
  out << message.imu_used << message.predicted << message.degenerate_axes << message.coverage_deg
      << message.points << message.points_used << message.correspondences << message.coarse_iterations
      << message.fine_iterations << message.map_voxels << message.lost_packets << message.missing_firings
      << message.superseded << message.degradation_level << message.guarded << message.overshoot_ns
      << message.drift_covariance;
}

template <class Out>
static void put(Out& out, const ImuPoseStatus& message) {
  put(out, message.stamp);
  put(out, message.scan_stamp);
  out << message.scan_sequence << message.correction_m << message.correction_rad << message.jumped
      << message.follows_gyro << message.jumps << message.published << message.thinned << message.withheld;
}

template <class Out>
static void put(Out& out, const DiagnosticArray& message) {
  put(out, message.stamp);
  out << message.frame_id << static_cast<std::uint32_t>(message.statuses.size());
  for (const DiagnosticStatus& status : message.statuses) {
    out << static_cast<std::uint8_t>(status.level) << status.name << status.message << status.hardware_id
        << static_cast<std::uint32_t>(status.values.size());
    for (const KeyValue& value : status.values) out << value.key << value.value;
  }
}

static void get(Input& in, Odometry& message) {
  get(in, message.stamp);
  in.cdr >> message.frame_id >> message.child_frame_id >> message.position >> message.orientation_xyzw >>
      message.pose_covariance >> message.linear_velocity >> message.angular_velocity >>
      message.twist_covariance;
}

static void get(Input& in, TransformMessage& message) {
  message.transforms.resize(get_length(in, kSmallestTransform));
  for (TransformStamped& transform : message.transforms) {
    get(in, transform.stamp);
    in.cdr >> transform.frame_id >> transform.child_frame_id >> transform.translation >>
        transform.rotation_xyzw;
  }
}

static void get(Input& in, LatencyReport& message) {
  get(in, message.stamp);
  message.stages.resize(get_length(in, kSmallestStage));
  for (StageLatency& stage : message.stages) {
    in.cdr >> stage.name >> stage.count >> stage.p50_us >> stage.p90_us >> stage.p99_us >> stage.p99_9_us >>
        stage.max_us;
    stage.buckets.resize(get_length(in, kSmallestBucket));
    for (LatencyBucket& bucket : stage.buckets) in.cdr >> bucket.from_us >> bucket.to_us >> bucket.count;
  }
  in.cdr >> message.poses_published >> message.failed_writes >> message.ring_dropped >>
      message.ring_high_water >> message.imu_poses_published >> message.imu_ring_dropped >>
      message.imu_ring_high_water;
}

static void get(Input& in, ScanReport& message) {
  get(in, message.stamp);
  get(in, message.scan_start);
  in.cdr >> message.sequence >> message.state >> message.stop_reason;
  get(in, message.delivered);
  in.cdr >> message.host_id;
  message.stages.resize(get_length(in, kSmallestStamp));
  for (StageStamp& stage : message.stages) in.cdr >> stage.name >> stage.monotonic_ns;
  in.cdr >> message.imu_used >> message.predicted >> message.degenerate_axes >> message.coverage_deg >>
      message.points >> message.points_used >> message.correspondences >> message.coarse_iterations >>
      message.fine_iterations >> message.map_voxels >> message.lost_packets >> message.missing_firings >>
      message.superseded >> message.degradation_level >> message.guarded >> message.overshoot_ns >>
      message.drift_covariance;
}

static void get(Input& in, ImuPoseStatus& message) {
  get(in, message.stamp);
  get(in, message.scan_stamp);
  in.cdr >> message.scan_sequence >> message.correction_m >> message.correction_rad >> message.jumped >>
      message.follows_gyro >> message.jumps >> message.published >> message.thinned >> message.withheld;
}

static void get(Input& in, DiagnosticArray& message) {
  get(in, message.stamp);
  in.cdr >> message.frame_id;
  message.statuses.resize(get_length(in, kSmallestStatus));
  for (DiagnosticStatus& status : message.statuses) {
    std::uint8_t level = 0;
    in.cdr >> level >> status.name >> status.message >> status.hardware_id;
    status.level = static_cast<DiagnosticStatus::Level>(level);
    status.values.resize(get_length(in, kSmallestKeyValue));
    for (KeyValue& value : status.values) in.cdr >> value.key >> value.value;
  }
}

template <>
constexpr RosType kRosType<Odometry>{
    "nav_msgs::msg::dds_::Odometry_",
    "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0"};
template <>
constexpr RosType kRosType<TransformMessage>{
    "tf2_msgs::msg::dds_::TFMessage_",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"};
template <>
constexpr RosType kRosType<LatencyReport>{
    "nilio::msg::dds_::LatencyReport_",
    "RIHS01_6360d839bc23566cd911230d2b4dd205d4c67bfba0ed7a0bcf81023a11d8be7d"};
template <>
constexpr RosType kRosType<ScanReport>{
    "nilio::msg::dds_::ScanReport_",
    "RIHS01_07b25fa86e0f0cd55fb52d4969d88ae10330fdcd2e418821eec2b5a449a95bf0"};
template <>
constexpr RosType kRosType<ImuPoseStatus>{
    "nilio::msg::dds_::ImuPoseStatus_",
    "RIHS01_a6ff5d8d4c353dc4abd74e5830fb358b83ed5e9ad1b9009ac5a039a7528d3a44"};
template <>
constexpr RosType kRosType<DiagnosticArray>{
    "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"};

// Typical message for preallocation.
static void make_typical(Odometry& message) {
  message.frame_id.assign(kTypicalName, 'x');
  message.child_frame_id.assign(kTypicalName, 'x');
}
static void make_typical(TransformMessage& message) {
  message.transforms.resize(1);
  message.transforms.front().frame_id.assign(kTypicalName, 'x');
  message.transforms.front().child_frame_id.assign(kTypicalName, 'x');
}
static void make_typical(LatencyReport& message) {
  message.stages.resize(kTypicalStages);
  for (StageLatency& stage : message.stages) {
    stage.name.assign(kTypicalName, 'x');
    stage.buckets.resize(kTypicalBuckets);
  }
}
static void make_typical(ScanReport& message) {
  for (std::string* text :
       {&message.state, &message.stop_reason, &message.host_id, &message.degradation_level})
    text->assign(kTypicalName, 'x');
  message.stages.resize(kTypicalStages);
  for (StageStamp& stage : message.stages) stage.name.assign(kTypicalName, 'x');
}
static void make_typical(ImuPoseStatus&) {}

static void make_typical(DiagnosticArray& message) {
  message.statuses.resize(kTypicalStatuses);
  for (DiagnosticStatus& status : message.statuses) {
    status.name.assign(kTypicalName, 'x');
    status.message.assign(kTypicalName, 'x');
    status.values.assign(kTypicalValues, {std::string(kTypicalName, 'x'), std::string(kTypicalName, 'x')});
  }
}

template class MessageType<Odometry>;
template class MessageType<TransformMessage>;
template class MessageType<LatencyReport>;
template class MessageType<DiagnosticArray>;
template class MessageType<ScanReport>;
template class MessageType<ImuPoseStatus>;

}  // namespace nilio::dds
