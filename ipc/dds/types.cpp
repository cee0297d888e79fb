#include "ipc/dds/types.hpp"

#include <cstddef>
#include <exception>
#include <stdexcept>
#include <string>

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>
#include <fastdds/rtps/common/SerializedPayload.h>

namespace nilio::dds {
namespace {

using eprosima::fastcdr::Cdr;

constexpr std::size_t kEncapsulationBytes = 4;
// Typical lengths for the preallocation of payloads; longer ones cost one reallocation.
constexpr std::size_t kTypicalName = 64;
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
constexpr std::int64_t kNsPerSecond = 1'000'000'000;

// Counts the bytes that the same calls on a Cdr would write, including alignment.
class SizeCounter {
 public:
  SizeCounter& operator<<(bool) { return add(1, 1); }
  SizeCounter& operator<<(std::uint8_t) { return add(1, 1); }
  SizeCounter& operator<<(std::int32_t) { return add(4, 4); }
  SizeCounter& operator<<(std::uint32_t) { return add(4, 4); }
  SizeCounter& operator<<(std::int64_t) { return add(8, 8); }
  SizeCounter& operator<<(std::uint64_t) { return add(8, 8); }
  SizeCounter& operator<<(float) { return add(4, 4); }
  SizeCounter& operator<<(double) { return add(8, 8); }
  SizeCounter& operator<<(const std::string& text) { return add(4, 4).add(1, text.size() + 1); }
  template <std::size_t N>
  SizeCounter& operator<<(const std::array<double, N>&) {
    return add(8, 8 * N);
  }
  [[nodiscard]] std::size_t bytes() const { return bytes_; }

 private:
  SizeCounter& add(std::size_t alignment, std::size_t size) {
    bytes_ = (bytes_ + alignment - 1) / alignment * alignment + size;
    return *this;
  }
  std::size_t bytes_ = 0;
};

template <class Out>
void put(Out& out, core::Time time) {
  const std::int64_t nanoseconds = ((time.ns % kNsPerSecond) + kNsPerSecond) % kNsPerSecond;
  out << static_cast<std::int32_t>((time.ns - nanoseconds) / kNsPerSecond)
      << static_cast<std::uint32_t>(nanoseconds);
}

template <class Out>
void put(Out& out, const Odometry& message) {
  put(out, message.stamp);
  out << message.frame_id << message.child_frame_id << message.position << message.orientation_xyzw
      << message.pose_covariance << message.linear_velocity << message.angular_velocity
      << message.twist_covariance;
}

template <class Out>
void put(Out& out, const TransformMessage& message) {
  out << static_cast<std::uint32_t>(message.transforms.size());
  for (const TransformStamped& transform : message.transforms) {
    put(out, transform.stamp);
    out << transform.frame_id << transform.child_frame_id << transform.translation << transform.rotation_xyzw;
  }
}

template <class Out>
void put(Out& out, const LatencyReport& message) {
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
void put(Out& out, const ScanReport& message) {
  put(out, message.stamp);
  put(out, message.scan_start);
  out << message.sequence << message.state << message.stop_reason;
  put(out, message.delivered);
  out << message.host_id << static_cast<std::uint32_t>(message.stages.size());
  for (const StageStamp& stage : message.stages) out << stage.name << stage.monotonic_ns;
  out << message.imu_used << message.predicted << message.degenerate_axes << message.coverage_deg
      << message.points << message.points_used << message.correspondences << message.coarse_iterations
      << message.fine_iterations << message.map_voxels << message.lost_packets << message.missing_firings
      << message.superseded << message.degradation_level << message.guarded << message.overshoot_ns;
}

template <class Out>
void put(Out& out, const ImuPoseStatus& message) {
  put(out, message.stamp);
  put(out, message.scan_stamp);
  out << message.scan_sequence << message.correction_m << message.correction_rad << message.jumped
      << message.follows_gyro << message.jumps << message.published << message.thinned << message.withheld;
}

template <class Out>
void put(Out& out, const DiagnosticArray& message) {
  put(out, message.stamp);
  out << message.frame_id << static_cast<std::uint32_t>(message.statuses.size());
  for (const DiagnosticStatus& status : message.statuses) {
    out << static_cast<std::uint8_t>(status.level) << status.name << status.message << status.hardware_id
        << static_cast<std::uint32_t>(status.values.size());
    for (const KeyValue& value : status.values) out << value.key << value.value;
  }
}

// Input of a payload: the Cdr, and the maximum number of bytes of a sequence.
struct Input {
  Cdr& cdr;
  std::size_t payload_bytes;
};

void get(Input& in, core::Time& time) {
  std::int32_t seconds = 0;
  std::uint32_t nanoseconds = 0;
  in.cdr >> seconds >> nanoseconds;
  time.ns = static_cast<std::int64_t>(seconds) * kNsPerSecond + nanoseconds;
}

// Reads a sequence length; throws if the elements cannot fit into the rest of the payload.
std::uint32_t get_length(Input& in, std::size_t smallest_element) {
  std::uint32_t length = 0;
  in.cdr >> length;
  const std::size_t left = in.payload_bytes - std::min(in.payload_bytes, in.cdr.getSerializedDataLength());
  if (length > left / smallest_element) throw std::length_error("sequence longer than its payload");
  return length;
}

void get(Input& in, Odometry& message) {
  get(in, message.stamp);
  in.cdr >> message.frame_id >> message.child_frame_id >> message.position >> message.orientation_xyzw >>
      message.pose_covariance >> message.linear_velocity >> message.angular_velocity >>
      message.twist_covariance;
}

void get(Input& in, TransformMessage& message) {
  message.transforms.resize(get_length(in, kSmallestTransform));
  for (TransformStamped& transform : message.transforms) {
    get(in, transform.stamp);
    in.cdr >> transform.frame_id >> transform.child_frame_id >> transform.translation >>
        transform.rotation_xyzw;
  }
}

void get(Input& in, LatencyReport& message) {
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

void get(Input& in, ScanReport& message) {
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
      message.superseded >> message.degradation_level >> message.guarded >> message.overshoot_ns;
}

void get(Input& in, ImuPoseStatus& message) {
  get(in, message.stamp);
  get(in, message.scan_stamp);
  in.cdr >> message.scan_sequence >> message.correction_m >> message.correction_rad >> message.jumped >>
      message.follows_gyro >> message.jumps >> message.published >> message.thinned >> message.withheld;
}

void get(Input& in, DiagnosticArray& message) {
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

template <class Message>
std::uint32_t serialized_bytes(const Message& message) {
  SizeCounter counter;
  put(counter, message);
  return static_cast<std::uint32_t>(kEncapsulationBytes + counter.bytes());
}

struct RosType {
  const char* name;
  std::string_view hash;
};
// Hashes of ipc/idl/nilio.idl; tests/support/type_hashes.py computes them.
template <class Message>
constexpr RosType kRosType{};
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
    "RIHS01_9a161ac49bbc3c24107a7b2eac2968b2cd65c10d732ed910d7b5310658f1b92a"};
template <>
constexpr RosType kRosType<ImuPoseStatus>{
    "nilio::msg::dds_::ImuPoseStatus_",
    "RIHS01_a6ff5d8d4c353dc4abd74e5830fb358b83ed5e9ad1b9009ac5a039a7528d3a44"};
template <>
constexpr RosType kRosType<DiagnosticArray>{
    "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"};

// Typical message for preallocation.
void make_typical(Odometry& message) {
  message.frame_id.assign(kTypicalName, 'x');
  message.child_frame_id.assign(kTypicalName, 'x');
}
void make_typical(TransformMessage& message) {
  message.transforms.resize(1);
  message.transforms.front().frame_id.assign(kTypicalName, 'x');
  message.transforms.front().child_frame_id.assign(kTypicalName, 'x');
}
void make_typical(LatencyReport& message) {
  message.stages.resize(kTypicalStages);
  for (StageLatency& stage : message.stages) {
    stage.name.assign(kTypicalName, 'x');
    stage.buckets.resize(kTypicalBuckets);
  }
}
void make_typical(ScanReport& message) {
  for (std::string* text :
       {&message.state, &message.stop_reason, &message.host_id, &message.degradation_level})
    text->assign(kTypicalName, 'x');
  message.stages.resize(kTypicalStages);
  for (StageStamp& stage : message.stages) stage.name.assign(kTypicalName, 'x');
}
void make_typical(ImuPoseStatus&) {}

void make_typical(DiagnosticArray& message) {
  message.statuses.resize(kTypicalStatuses);
  for (DiagnosticStatus& status : message.statuses) {
    status.name.assign(kTypicalName, 'x');
    status.message.assign(kTypicalName, 'x');
    status.values.assign(kTypicalValues, {std::string(kTypicalName, 'x'), std::string(kTypicalName, 'x')});
  }
}

}  // namespace

template <class Message>
MessageType<Message>::MessageType() {
  Message typical;
  make_typical(typical);
  setName(kRosType<Message>.name);
  m_typeSize = serialized_bytes(typical);
  m_isGetKeyDefined = false;
  auto_fill_type_information(false);
  auto_fill_type_object(false);
}

template <class Message>
std::string_view MessageType<Message>::type_hash() {
  return kRosType<Message>.hash;
}

template <class Message>
bool MessageType<Message>::serialize(void* data, Payload* payload) {
  try {
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->max_size);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    payload->encapsulation = cdr.endianness() == Cdr::BIG_ENDIANNESS ? CDR_BE : CDR_LE;
    cdr.serialize_encapsulation();
    put(cdr, *static_cast<const Message*>(data));
    payload->length = static_cast<std::uint32_t>(cdr.getSerializedDataLength());
    return true;
  } catch (const std::exception&) {
    return false;  // larger than the payload: Fast DDS reports the failed write
  }
}

template <class Message>
bool MessageType<Message>::deserialize(Payload* payload, void* data) {
  try {
    if (payload->length < kEncapsulationBytes || payload->data[0] != 0 || payload->data[1] > 1) return false;
    eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(payload->data), payload->length);
    Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
    cdr.read_encapsulation();
    payload->encapsulation = cdr.endianness() == Cdr::BIG_ENDIANNESS ? CDR_BE : CDR_LE;
    Input in{cdr, payload->length};
    get(in, *static_cast<Message*>(data));
    return true;
  } catch (const std::exception&) {
    return false;
  }
}

template <class Message>
std::function<std::uint32_t()> MessageType<Message>::getSerializedSizeProvider(void* data) {
  return [data] { return serialized_bytes(*static_cast<const Message*>(data)); };
}

template class MessageType<Odometry>;
template class MessageType<TransformMessage>;
template class MessageType<LatencyReport>;
template class MessageType<DiagnosticArray>;
template class MessageType<ScanReport>;
template class MessageType<ImuPoseStatus>;

}  // namespace nilio::dds
