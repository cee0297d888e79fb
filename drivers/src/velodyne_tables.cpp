#include "velodyne_tables.hpp"

#include <array>

namespace nilio::drivers {
namespace {

// VLP-16 user manual 63-9243: elevations in firing order; the vertical offsets follow from the crossing of
// the beams.
constexpr std::array<LaserRow, 16> kVlp16Lasers{{
    {.elevation_deg = -15.0},
    {.elevation_deg = 1.0},
    {.elevation_deg = -13.0},
    {.elevation_deg = 3.0},
    {.elevation_deg = -11.0},
    {.elevation_deg = 5.0},
    {.elevation_deg = -9.0},
    {.elevation_deg = 7.0},
    {.elevation_deg = -7.0},
    {.elevation_deg = 9.0},
    {.elevation_deg = -5.0},
    {.elevation_deg = 11.0},
    {.elevation_deg = -3.0},
    {.elevation_deg = 13.0},
    {.elevation_deg = -1.0},
    {.elevation_deg = 15.0},
}};

// KITTI's HDL-64E S2, recovered from KITTI's raw clouds: elevation, azimuth correction, vertical and
// horizontal offset, distance correction modulo the 2 mm resolution.
constexpr std::array<LaserRow, 64> kHdl64eKittiLasers{{
    {-7.2873, -4.353, 0.1974, 0.026, 0.00030},  {-6.9990, -2.244, 0.1977, -0.026, 0.00101},
    {0.1806, 3.430, 0.2068, 0.026, 0.00198},    {0.5788, 5.682, 0.2073, -0.026, 0.00008},
    {-6.6757, -0.086, 0.1982, 0.026, 0.00078},  {-6.3289, 2.174, 0.1986, -0.026, 0.00156},
    {-8.7114, -0.864, 0.1956, 0.026, 0.00127},  {-8.3105, 1.398, 0.1961, -0.026, 0.00077},
    {-5.9584, 4.183, 0.1991, 0.026, 0.00030},   {-5.6106, 6.425, 0.1995, -0.026, 0.00126},
    {-8.0580, 3.427, 0.1964, 0.026, 0.00120},   {-7.6788, 5.671, 0.1969, -0.026, 0.00036},
    {-3.2359, -4.365, 0.2025, 0.026, 0.00005},  {-2.8738, -2.124, 0.2030, -0.026, 0.00085},
    {-5.2508, -5.132, 0.2000, 0.026, 0.00032},  {-4.9138, -2.878, 0.2004, -0.026, 0.00060},
    {-2.5466, -0.131, 0.2034, 0.026, 0.00100},  {-2.2076, 2.171, 0.2038, -0.026, 0.00178},
    {-4.5881, -0.875, 0.2008, 0.026, 0.00043},  {-4.2155, 1.380, 0.2013, -0.026, 0.00016},
    {-1.8333, 4.132, 0.2043, 0.026, 0.00003},   {-1.4939, 6.379, 0.2047, -0.026, 0.00116},
    {-3.9358, 3.375, 0.2016, 0.026, 0.00087},   {-3.5393, 5.616, 0.2021, -0.026, 0.00200},
    {0.8716, -4.367, 0.2077, 0.026, 0.00089},   {1.3048, -2.135, 0.2082, -0.026, 0.00064},
    {-1.2012, -5.142, 0.2051, 0.026, 0.00157},  {-0.8032, -2.887, 0.2056, -0.026, 0.00141},
    {1.5740, -0.152, 0.2085, 0.026, 0.00015},   {1.9367, 2.124, 0.2090, -0.026, 0.00141},
    {-0.4518, -0.912, 0.2060, 0.026, 0.00062},  {-0.0888, 1.339, 0.2065, -0.026, 0.00019},
    {-22.8566, -7.283, 0.1080, 0.026, 0.00132}, {-22.4376, -3.835, 0.1085, -0.026, 0.00005},
    {-11.5990, 5.071, 0.1214, 0.026, 0.00011},  {-10.9569, 8.318, 0.1221, -0.026, 0.00016},
    {-21.9355, -0.420, 0.1091, 0.026, 0.00129}, {-21.3181, 3.127, 0.1099, -0.026, 0.00187},
    {-24.9992, -1.652, 0.1052, 0.026, 0.00053}, {-24.5066, 1.869, 0.1058, -0.026, 0.00090},
    {-20.7877, 6.497, 0.1106, 0.026, 0.00094},  {-20.2226, 9.911, 0.1113, -0.026, 0.00106},
    {-23.9710, 5.277, 0.1065, 0.026, 0.00166},  {-23.3224, 8.855, 0.1074, -0.026, 0.00151},
    {-16.5540, -7.141, 0.1157, 0.026, 0.00107}, {-16.1766, -3.709, 0.1161, -0.026, 0.00089},
    {-19.7364, -8.445, 0.1119, 0.026, 0.00181}, {-19.3202, -4.969, 0.1124, -0.026, 0.00078},
    {-15.6567, -0.427, 0.1167, 0.026, 0.00149}, {-15.1887, 2.988, 0.1173, -0.026, 0.00007},
    {-18.7971, -1.660, 0.1130, 0.026, 0.00056}, {-18.3234, 1.821, 0.1136, -0.026, 0.00199},
    {-14.5981, 6.261, 0.1180, 0.026, 0.00120},  {-14.0483, 9.652, 0.1186, -0.026, 0.00060},
    {-17.7304, 5.085, 0.1143, 0.026, 0.00198},  {-17.1868, 8.578, 0.1149, -0.026, 0.00117},
    {-10.4707, -6.987, 0.1227, 0.026, 0.00100}, {-10.0625, -3.631, 0.1231, -0.026, 0.00075},
    {-13.4848, -8.272, 0.1192, 0.026, 0.00161}, {-13.0410, -4.844, 0.1198, -0.026, 0.00146},
    {-9.5735, -0.373, 0.1237, 0.026, 0.00047},  {-9.0260, 2.864, 0.1243, -0.026, 0.00124},
    {-12.5621, -1.640, 0.1203, 0.026, 0.00161}, {-12.1150, 1.754, 0.1208, -0.026, 0.00073},
}};

constexpr std::array<std::uint16_t, 1> kUpperFlags{0xEEFF};
constexpr std::array<std::uint16_t, 2> kUpperLowerFlags{0xEEFF, 0xDDFF};

/// One laser every 2.304 us; a firing of 16 and its recharge last 55.296 us (manual 63-9243).
std::int64_t vlp16_firing_offset_ns(std::size_t laser) { return 2304 * static_cast<std::int64_t>(laser); }

constexpr std::array<std::int64_t, 4> kHdl64eWithinGroupNs{0, 1260, 2460, 3660};

/// Groups of four every 6 us; the two banks of 32 fire together (HDL-64E S2 manual, firing table).
std::int64_t hdl64e_firing_offset_ns(std::size_t laser) {
  const std::size_t in_bank = laser % 32;
  return 6000 * static_cast<std::int64_t>(in_bank / 4) + kHdl64eWithinGroupNs[in_bank % 4];
}

constexpr ModelTable kVlp16{
    .name = "VLP-16",
    .lasers = kVlp16Lasers,
    .beam_crossing_m = 0.04191,
    .firing_period_ns = 55'296,
    .firing_offset_ns = vlp16_firing_offset_ns,
    .azimuth_period_ns = 110'592,
    .azimuth_interpolated = true,
    .flags = kUpperFlags,
    .return_mode_byte = 0x37,
    .product_byte = 0x22,
};

// Not interpolated: the factory's azimuth corrections, and KITTI's clouds, are for one azimuth per column.
constexpr ModelTable kHdl64eS2{
    .name = "HDL-64E-S2",
    .lasers = kHdl64eKittiLasers,
    .vertical_offset_across_beam = true,
    .firing_period_ns = 48'000,
    .firing_offset_ns = hdl64e_firing_offset_ns,
    .blocks_per_azimuth = 2,
    .azimuth_period_ns = 48'000,
    .flags = kUpperLowerFlags,
};

}  // namespace

const ModelTable& model_table(VelodyneModel model) {
  switch (model) {
    case VelodyneModel::kHdl64eS2:
      return kHdl64eS2;
    case VelodyneModel::kVlp16:
      break;
  }
  return kVlp16;
}

}  // namespace nilio::drivers
