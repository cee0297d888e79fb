#include "tools/map/las.hpp"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <limits>
#include <string_view>

namespace nilio::tools::map {

namespace {

using mapping::ByteWriter;

constexpr double kScale = 0.001;
constexpr std::uint16_t kHeaderBytes = 375;
constexpr std::uint16_t kPointBytes = 30;
constexpr std::array<const char*, 3> kExtraNames{"nx", "ny", "nz"};
constexpr std::uint16_t kExtraBytes = 4 * kExtraNames.size();
constexpr std::uint16_t kExtraRecordBytes = 192 * kExtraNames.size();
constexpr std::uint32_t kVariableBytes = 54 + kExtraRecordBytes;

/// Text of constant length, filled up with zeros.
void put_text(ByteWriter& out, std::string_view text, std::size_t length) {
  for (std::size_t i = 0; i < length; ++i) out.put(i < text.size() ? text[i] : '\0');
}

/// GPS time minus 1e9 s, of a stamp in UTC.
double adjusted_gps_time(core::Time stamp) {
  constexpr std::int64_t gps_epoch_s = 315'964'800;
  constexpr std::int64_t leap_seconds = 18;
  constexpr std::int64_t adjustment_s = 1'000'000'000;
  const std::int64_t offset_ns = (leap_seconds - gps_epoch_s - adjustment_s) * 1'000'000'000;
  return static_cast<double>(stamp.ns + offset_ns) * 1e-9;
}

std::int32_t las_coordinate(double value, double offset) {
  const double steps = std::round((value - offset) / kScale);
  return static_cast<std::int32_t>(std::clamp<double>(steps, std::numeric_limits<std::int32_t>::min(),
                                                      std::numeric_limits<std::int32_t>::max()));
}

void put_extra_bytes_record(ByteWriter& out) {
  out.put(std::uint16_t{0});
  put_text(out, "LASF_Spec", 16);
  out.put(std::uint16_t{4});
  out.put(kExtraRecordBytes);
  put_text(out, "normals", 32);
  for (const char* const name : kExtraNames) {
    out.put(std::uint16_t{0});
    out.put(std::uint8_t{9});  // float
    out.put(std::uint8_t{0});
    put_text(out, name, 32);
    put_text(out, "", 4 + 5 * 24);
    put_text(out, "surface normal", 32);
  }
}

}  // namespace

std::string las_header(const LasCoordinates& coordinates) {
  const std::time_t now = std::time(nullptr);
  std::tm date{};
  gmtime_r(&now, &date);
  ByteWriter out;
  put_text(out, "LASF", 4);
  out.put(std::uint16_t{0});        // file source
  out.put(std::uint16_t{0b10001});  // adjusted standard GPS time; WKT
  put_text(out, "", 16);            // GUID
  out.put(std::uint8_t{1});
  out.put(std::uint8_t{4});
  put_text(out, "nilio", 32);
  put_text(out, "nilio map export", 32);
  out.put(static_cast<std::uint16_t>(date.tm_yday + 1));
  out.put(static_cast<std::uint16_t>(date.tm_year + 1900));
  out.put(kHeaderBytes);
  out.put(kHeaderBytes + kVariableBytes);
  out.put(std::uint32_t{1});  // variable length records
  out.put(std::uint8_t{6});   // point format
  out.put(static_cast<std::uint16_t>(kPointBytes + kExtraBytes));
  for (int i = 0; i < 6; ++i) out.put(std::uint32_t{0});  // legacy counts
  for (int i = 0; i < 3; ++i) out.put(kScale);
  for (int i = 0; i < 3; ++i) out.put(coordinates.offset[i]);
  for (std::size_t i = 0; i < 3; ++i) {
    const double offset = coordinates.offset[static_cast<Eigen::Index>(i)];
    out.put(coordinates.maximum[i] * kScale + offset);
    out.put(coordinates.minimum[i] * kScale + offset);
  }
  out.put(std::uint64_t{0});  // waveforms
  out.put(std::uint64_t{0});  // extended variable length records
  out.put(std::uint32_t{0});
  out.put(coordinates.points);
  out.put(coordinates.points);  // all are first returns
  for (int i = 1; i < 15; ++i) out.put(std::uint64_t{0});
  put_extra_bytes_record(out);
  const mapping::Bytes bytes = out.take();
  return {bytes.begin(), bytes.end()};
}

void put_las_point(const mapping::CloudPoint& point, LasCoordinates& coordinates, ByteWriter& out) {
  for (std::size_t i = 0; i < 3; ++i) {
    const auto axis = static_cast<Eigen::Index>(i);
    const std::int32_t value = las_coordinate(point.position[axis], coordinates.offset[axis]);
    const bool is_first = coordinates.points == 0;
    coordinates.minimum[i] = is_first ? value : std::min(coordinates.minimum[i], value);
    coordinates.maximum[i] = is_first ? value : std::max(coordinates.maximum[i], value);
    out.put(value);
  }
  ++coordinates.points;
  out.put(static_cast<std::uint16_t>(grey_of(point) * 257));
  out.put(std::uint8_t{0x11});  // return 1 of 1
  out.put(std::uint8_t{0});
  out.put(std::uint8_t{1});  // unclassified
  out.put(std::uint8_t{0});
  out.put(std::int16_t{0});   // scan angle
  out.put(std::uint16_t{0});  // point source
  out.put(adjusted_gps_time(point.stamp));
  for (int i = 0; i < 3; ++i) out.put(point.normal[i]);
}

}  // namespace nilio::tools::map
