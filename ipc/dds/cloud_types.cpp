#include "ipc/dds/type_support.hpp"

#include <cstddef>
#include <cstdint>

namespace nilio::dds {
namespace {

// Minimum sizes, with empty names.
constexpr std::size_t kSmallestField = 4 + 4 + 1 + 4;
constexpr std::size_t kSmallestPose = 8 + 4 + 7 * 8;
constexpr std::size_t kTypicalFields = 8;

}  // namespace

template <class Out>
static void put(Out& out, const PointCloud2& message) {
  put(out, message.stamp);
  out << message.frame_id << message.height << message.width
      << static_cast<std::uint32_t>(message.fields.size());
  for (const PointField& field : message.fields)
    out << field.name << field.offset << field.datatype << field.count;
  out << message.is_bigendian << message.point_step << message.row_step << message.data << message.is_dense;
}

template <class Out>
static void put(Out& out, const Path& message) {
  put(out, message.stamp);
  out << message.frame_id << static_cast<std::uint32_t>(message.poses.size());
  for (const PoseStamped& pose : message.poses) {
    put(out, pose.stamp);
    out << pose.frame_id << pose.position << pose.orientation_xyzw;
  }
}

static void get(Input& in, PointCloud2& message) {
  get(in, message.stamp);
  in.cdr >> message.frame_id >> message.height >> message.width;
  message.fields.resize(get_length(in, kSmallestField));
  for (PointField& field : message.fields)
    in.cdr >> field.name >> field.offset >> field.datatype >> field.count;
  in.cdr >> message.is_bigendian >> message.point_step >> message.row_step;
  message.data.resize(get_length(in, 1));
  in.cdr.deserializeArray(message.data.data(), message.data.size());
  in.cdr >> message.is_dense;
}

static void get(Input& in, Path& message) {
  get(in, message.stamp);
  in.cdr >> message.frame_id;
  message.poses.resize(get_length(in, kSmallestPose));
  for (PoseStamped& pose : message.poses) {
    get(in, pose.stamp);
    in.cdr >> pose.frame_id >> pose.position >> pose.orientation_xyzw;
  }
}

template <>
constexpr RosType kRosType<PointCloud2>{
    "sensor_msgs::msg::dds_::PointCloud2_",
    "RIHS01_9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5"};
template <>
constexpr RosType kRosType<Path>{"nav_msgs::msg::dds_::Path_",
                                 "RIHS01_1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b"};

// Without points: their number is known only when they are written, and a payload grows once.
static void make_typical(PointCloud2& message) {
  message.frame_id.assign(kTypicalName, 'x');
  message.fields.resize(kTypicalFields);
  for (PointField& field : message.fields) field.name.assign(kTypicalName, 'x');
}
static void make_typical(Path& message) { message.frame_id.assign(kTypicalName, 'x'); }

template class MessageType<PointCloud2>;
template class MessageType<Path>;

}  // namespace nilio::dds
