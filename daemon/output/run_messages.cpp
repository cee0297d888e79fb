#include "daemon/output/run_messages.hpp"

#include "nilio/core/units.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <initializer_list>
#include <string_view>
#include <type_traits>
#include <utility>

namespace nilio::daemon {

namespace {

constexpr std::uint8_t kFloat32 = 7;

struct Definition {
  std::string_view name;
  std::string_view text;
};
constexpr Definition kTime{"builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n"};
constexpr Definition kHeader{"std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n"};
constexpr Definition kPoint{"geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"};
constexpr Definition kVector{"geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"};
constexpr Definition kQuaternion{"geometry_msgs/Quaternion",
                                 "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"};
constexpr Definition kPose{"geometry_msgs/Pose", "Point position\nQuaternion orientation\n"};
constexpr Definition kTwist{"geometry_msgs/Twist", "Vector3 linear\nVector3 angular\n"};
constexpr Definition kPoseCovariance{"geometry_msgs/PoseWithCovariance",
                                     "Pose pose\nfloat64[36] covariance\n"};
constexpr Definition kTwistCovariance{"geometry_msgs/TwistWithCovariance",
                                      "Twist twist\nfloat64[36] covariance\n"};
constexpr Definition kTransform{"geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation\n"};
constexpr Definition kTransformStamped{
    "geometry_msgs/TransformStamped", "std_msgs/Header header\nstring child_frame_id\nTransform transform\n"};
constexpr Definition kPoseStamped{"geometry_msgs/PoseStamped", "std_msgs/Header header\nPose pose\n"};
constexpr Definition kPointField{
    "sensor_msgs/PointField",
    "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 "
    "UINT32=6\nuint8 FLOAT32=7\nuint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 "
    "datatype\nuint32 count\n"};
constexpr Definition kKeyValue{"diagnostic_msgs/KeyValue", "string key\nstring value\n"};
constexpr Definition kStatus{
    "diagnostic_msgs/DiagnosticStatus",
    "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\nstring "
    "message\nstring hardware_id\nKeyValue[] values\n"};

/// Definition of a type and of those it depends on.
std::string definition(std::string_view text, std::initializer_list<Definition> dependencies) {
  std::string result(text);
  for (const Definition& dependency : dependencies) {
    result += std::string(80, '=') + "\nMSG: ";
    result += dependency.name;
    result += '\n';
    result += dependency.text;
  }
  return result;
}

/// Appends fields of a message in CDR; alignment counts from behind the encapsulation.
class CdrWriter {
 public:
  explicit CdrWriter(std::vector<std::uint8_t>& out) : out_(out) { out_.assign({0, 1, 0, 0}); }

  template <class T>
  CdrWriter& number(T value) {
    static_assert(std::is_arithmetic_v<T>);
    while ((out_.size() - 4) % sizeof(T) != 0) out_.push_back(0);
    std::memcpy(extend(sizeof(T)), &value, sizeof(T));
    return *this;
  }
  template <std::size_t N>
  CdrWriter& numbers(const std::array<double, N>& values) {
    for (const double value : values) number(value);
    return *this;
  }
  CdrWriter& text(std::string_view value) {
    length(value.size() + 1);
    std::uint8_t* const bytes = extend(value.size() + 1);
    if (!value.empty()) std::memcpy(bytes, value.data(), value.size());
    bytes[value.size()] = 0;
    return *this;
  }
  CdrWriter& length(std::size_t count) { return number(static_cast<std::uint32_t>(count)); }
  CdrWriter& header(std::int64_t stamp_ns, std::string_view frame) {
    const std::int64_t nanoseconds =
        ((stamp_ns % kNanosecondsPerSecond) + kNanosecondsPerSecond) % kNanosecondsPerSecond;
    number(static_cast<std::int32_t>((stamp_ns - nanoseconds) / kNanosecondsPerSecond));
    number(static_cast<std::uint32_t>(nanoseconds));
    return text(frame);
  }
  /// Bytes to be filled.
  std::uint8_t* extend(std::size_t count) {
    out_.resize(out_.size() + count);
    return out_.data() + out_.size() - count;
  }

 private:
  std::vector<std::uint8_t>& out_;
};

}  // namespace

namespace {

drivers::McapWriter::Channel transform_channel() {
  return {"/tf", "tf2_msgs/msg/TFMessage",
          definition("geometry_msgs/TransformStamped[] transforms\n",
                     {kTransformStamped, kHeader, kTime, kTransform, kVector, kQuaternion})};
}

drivers::McapWriter::Channel cloud_channel(const char* topic) {
  return {topic, "sensor_msgs/msg/PointCloud2",
          definition("std_msgs/Header header\nuint32 height\nuint32 width\nPointField[] fields\nbool "
                     "is_bigendian\nuint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
                     {kHeader, kTime, kPointField})};
}

drivers::McapWriter::Channel path_channel() {
  return {"/path", "nav_msgs/msg/Path",
          definition("std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
                     {kHeader, kTime, kPoseStamped, kPose, kPoint, kQuaternion})};
}

}  // namespace

std::vector<drivers::McapWriter::Channel> trajectory_channels() {
  drivers::McapWriter::Channel path = path_channel();
  path.is_latched = true;
  return {{"/pose", "geometry_msgs/msg/PoseStamped",
           definition(kPoseStamped.text, {kHeader, kTime, kPose, kPoint, kQuaternion})},
          transform_channel(),
          std::move(path)};
}

std::vector<drivers::McapWriter::Channel> run_channels() {
  return {
      {"/odom", "nav_msgs/msg/Odometry",
       definition(
           "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance "
           "pose\ngeometry_msgs/TwistWithCovariance twist\n",
           {kHeader, kTime, kPoseCovariance, kPose, kPoint, kQuaternion, kTwistCovariance, kTwist, kVector})},
      transform_channel(),
      path_channel(),
      cloud_channel("/scan_registered"),
      cloud_channel("/submaps"),
      {"/diagnostics", "diagnostic_msgs/msg/DiagnosticArray",
       definition("std_msgs/Header header\nDiagnosticStatus[] status\n",
                  {kHeader, kTime, kStatus, kKeyValue})},
      {"/latency_ms", "std_msgs/msg/Float64", "float64 data\n"},
  };
}

void write_odometry(const ipc::PoseRecord& record, const RunFrames& frames, std::vector<std::uint8_t>& out) {
  CdrWriter(out)
      .header(record.stamp_ns, frames.odom)
      .text(frames.base)
      .numbers(record.position)
      .numbers(record.orientation_xyzw)
      .numbers(record.pose_covariance)
      .numbers(record.linear_velocity)
      .numbers(record.angular_velocity)
      .numbers(record.twist_covariance);
}

void write_pose(const StampedPose& pose, const RunFrames& frames, std::vector<std::uint8_t>& out) {
  CdrWriter(out).header(pose.stamp_ns, frames.odom).numbers(pose.position).numbers(pose.orientation_xyzw);
}

void write_transform(const StampedPose& pose, const RunFrames& frames, std::vector<std::uint8_t>& out) {
  CdrWriter(out)
      .length(1)
      .header(pose.stamp_ns, frames.odom)
      .text(frames.base)
      .numbers(pose.position)
      .numbers(pose.orientation_xyzw);
}

void write_path(std::span<const StampedPose> poses, const RunFrames& frames, std::vector<std::uint8_t>& out) {
  CdrWriter writer(out);
  writer.header(poses.empty() ? 0 : poses.back().stamp_ns, frames.odom).length(poses.size());
  for (const StampedPose& pose : poses)
    writer.header(pose.stamp_ns, frames.odom).numbers(pose.position).numbers(pose.orientation_xyzw);
}

namespace {

/// Points of 32-bit floats: x, y, z and, as the fourth of `step` bytes, intensity.
void write_points(std::int64_t stamp_ns, const RunFrames& frames, std::uint32_t count, std::uint32_t step,
                  const void* data, std::vector<std::uint8_t>& out) {
  constexpr std::array<std::string_view, 4> kFields{"x", "y", "z", "intensity"};
  const std::uint32_t fields = step / 4;
  CdrWriter writer(out);
  writer.header(stamp_ns, frames.odom).number(std::uint32_t{1}).number(count).length(fields);
  for (std::uint32_t i = 0; i < fields; ++i)
    writer.text(kFields[i]).number(4 * i).number(kFloat32).number(std::uint32_t{1});
  writer.number(std::uint8_t{0}).number(step).number(step * count).number(step * count);
  if (count > 0) std::memcpy(writer.extend(step * count), data, step * count);
  writer.number(std::uint8_t{1});
}

}  // namespace

void write_scan(const CloudRecord& cloud, const RunFrames& frames, std::vector<std::uint8_t>& out) {
  write_points(cloud.stamp_ns, frames, cloud.count, 12, cloud.points.data(), out);
}

void write_submap(const ipc::SubmapCloud& submap, const RunFrames& frames, std::vector<std::uint8_t>& out) {
  const auto count = static_cast<std::uint32_t>(std::min<std::uint64_t>(submap.count, submap.points.size()));
  write_points(submap.stamp_ns, frames, count, sizeof(ipc::CloudPoint), submap.points.data(), out);
}

void write_diagnostics(const dds::DiagnosticArray& array, std::vector<std::uint8_t>& out) {
  CdrWriter writer(out);
  writer.header(array.stamp.ns, array.frame_id).length(array.statuses.size());
  for (const dds::DiagnosticStatus& status : array.statuses) {
    writer.number(static_cast<std::uint8_t>(status.level)).text(status.name).text(status.message);
    writer.text(status.hardware_id).length(status.values.size());
    for (const dds::KeyValue& value : status.values) writer.text(value.key).text(value.value);
  }
}

void write_number(double value, std::vector<std::uint8_t>& out) { CdrWriter(out).number(value); }

}  // namespace nilio::daemon
