#pragma once

#include <algorithm>
#include <cstring>
#include <nilio/core/scan.hpp>
#include <string>

namespace nilio_example {

/// Reads one scalar field of a point as double. Supports the datatypes that LiDAR drivers use.
inline double read_field(const std::uint8_t* point, std::uint32_t offset, std::uint8_t datatype) {
  const auto as = [&](auto value) {
    std::memcpy(&value, point + offset, sizeof value);
    return static_cast<double>(value);
  };
  switch (datatype) {  // sensor_msgs/msg/PointField
    case 2:
      return as(std::uint8_t{});
    case 4:
      return as(std::uint16_t{});
    case 6:
      return as(std::uint32_t{});
    case 7:
      return as(float{});
    case 8:
      return as(double{});
    default:
      return 0.0;
  }
}

/// Bytes of a PointField datatype.
inline std::uint64_t size_of(std::uint8_t datatype) {
  return datatype <= 2 ? 1 : datatype <= 4 ? 2 : datatype <= 7 ? 4 : 8;
}

/// Fills `scan` from a little-endian sensor_msgs::msg::PointCloud2 with fields x, y, z and optionally
/// intensity, ring and `time` or `t` (seconds as float, nanoseconds as integer, relative to the header's
/// stamp). Returns an error message, or an empty string. `Cloud` is a template parameter so that the
/// conversion compiles and is tested without ROS.
template <class Cloud>
std::string to_scan(const Cloud& cloud, nilio::core::Scan& scan) {
  const auto find = [&](const char* name) {
    return std::find_if(cloud.fields.begin(), cloud.fields.end(),
                        [&](const auto& f) { return f.name == name; });
  };
  const auto x = find("x"), y = find("y"), z = find("z"), intensity = find("intensity"), ring = find("ring");
  auto time = find("time");
  if (time == cloud.fields.end()) time = find("t");
  const auto none = cloud.fields.end();
  if (x == none || y == none || z == none)
    return "cloud: fields x, y, z are missing - check the driver's point type";
  const std::size_t count = std::size_t{cloud.width} * cloud.height;
  for (const auto& field : cloud.fields) {
    if (std::uint64_t{field.offset} + size_of(field.datatype) > cloud.point_step)
      return "cloud: field " + field.name + " exceeds point_step";
  }
  if (cloud.data.size() < count * cloud.point_step)
    return "cloud: data is shorter than width x height points";

  const auto get = [&](const std::uint8_t* p, const auto& field) {
    return read_field(p, field->offset, field->datatype);
  };
  scan.points.clear();
  std::int32_t last_ns = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* p = cloud.data.data() + i * cloud.point_step;
    nilio::core::Point point;
    point.x = static_cast<float>(get(p, x));
    point.y = static_cast<float>(get(p, y));
    point.z = static_cast<float>(get(p, z));
    if (intensity != none) point.intensity = static_cast<float>(get(p, intensity));
    if (ring != none) point.ring = static_cast<std::uint16_t>(get(p, ring));
    if (time != none)
      point.time_offset_ns = static_cast<std::int32_t>(get(p, time) * (time->datatype >= 7 ? 1e9 : 1.0));
    last_ns = std::max(last_ns, point.time_offset_ns);
    scan.points.push_back(point);
  }
  scan.start = {std::int64_t{cloud.header.stamp.sec} * 1'000'000'000 + cloud.header.stamp.nanosec};
  scan.end = scan.start + nilio::core::Duration{last_ns};
  scan.motion_compensated = time == none;
  return {};
}

}  // namespace nilio_example
