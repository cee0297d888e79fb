#include "drivers/velodyne/tables.hpp"

#include <array>

namespace nilio::drivers {
namespace {

constexpr std::array<std::uint16_t, 4> kBankFlags{0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF};
constexpr std::array kSingleOnly{ReturnMode::kSingle};
constexpr std::array kSingleAndDual{ReturnMode::kSingle, ReturnMode::kDual};
constexpr std::array kAllModes{ReturnMode::kSingle, ReturnMode::kDual, ReturnMode::kDualConfidence};

std::int64_t signed_of(std::size_t value) { return static_cast<std::int64_t>(value); }

/// One laser every 2.304 us; a firing of 16 and its recharge last 55.296 us (manual 63-9243).
std::int64_t vlp16_offset_ns(std::size_t laser, ReturnMode /*mode*/) { return 2304 * signed_of(laser); }

/// One laser every 1.152 us; a firing of 32 and its recharge last 46.080 us.
std::int64_t hdl32e_offset_ns(std::size_t laser, ReturnMode /*mode*/) { return 1152 * signed_of(laser); }

/// Pairs every 2.304 us (manual 63-9325).
std::int64_t vlp32_offset_ns(std::size_t laser, ReturnMode /*mode*/) { return 2304 * signed_of(laser / 2); }

/// Groups of eight every 2.665 us; after eight groups, and at the end, the sensor rests for two slots
/// (manual 63-9483).
std::int64_t vls128_offset_ns(std::size_t laser, ReturnMode /*mode*/) {
  const std::size_t group = laser / 8;
  return 2665 * signed_of(group < 8 ? group : group + 2);
}

/// Groups of four; the two banks of 32 fire together (HDL-64E S2 and S3 manuals, firing tables).
std::int64_t hdl64e_offset_ns(std::size_t laser, ReturnMode mode) {
  constexpr std::array<std::int64_t, 4> kSingle{0, 1260, 2460, 3660};
  constexpr std::array<std::int64_t, 4> kDual{0, 1300, 2500, 3700};
  const std::size_t in_bank = laser % 32;
  return mode == ReturnMode::kDual ? 7200 * signed_of(in_bank / 4) + kDual[in_bank % 4]
                                   : 6000 * signed_of(in_bank / 4) + kSingle[in_bank % 4];
}

ModelTable puck(std::string_view name, std::span<const LaserRow> lasers, std::uint8_t product_byte) {
  return {.name = name,
          .lasers = lasers,
          .beam_crossing_m = 0.04191,
          .firing_period_ns = {55'296, 55'296, 0},
          .firing_offset_ns = vlp16_offset_ns,
          .azimuth_interpolated = true,
          .flags = std::span(kBankFlags).first(1),
          .firings_per_block = 2,
          .modes = kSingleAndDual,
          .product_byte = product_byte};
}

ModelTable hdl32e() {
  return {.name = "HDL-32E",
          .lasers = hdl32e_lasers(),
          .beam_crossing_m = 0.02883,
          .firing_period_ns = {46'080, 46'080, 0},
          .firing_offset_ns = hdl32e_offset_ns,
          .azimuth_interpolated = true,
          .flags = std::span(kBankFlags).first(1),
          .modes = kSingleAndDual,
          .product_byte = 0x21};
}

ModelTable vlp32(std::string_view name, std::span<const LaserRow> lasers, std::uint8_t product_byte) {
  return {.name = name,
          .lasers = lasers,
          .distance_resolution_m = 0.004,
          .beam_crossing_m = 0.0424,
          .firing_period_ns = {55'296, 55'296, 0},
          .firing_offset_ns = vlp32_offset_ns,
          .azimuth_interpolated = true,
          .flags = std::span(kBankFlags).first(1),
          .modes = kSingleAndDual,
          .product_byte = product_byte};
}

/// The stamp is aligned with the fourth group, 7 us after the first. PTP: Alpha Prime firmware; the manuals
/// of all other models know GPS only.
ModelTable vls128() {
  return {.name = "VLS-128",
          .lasers = vls128_lasers(),
          .distance_resolution_m = 0.004,
          .beam_crossing_m = 0.05863,
          .firing_period_ns = {53'300, 53'300, 53'300},
          .firing_offset_ns = vls128_offset_ns,
          .first_firing_ns = -7'000,
          .azimuth_interpolated = true,
          .measured_period = true,
          .has_ptp = true,
          .flags = kBankFlags,
          .modes = kAllModes,
          .product_byte = 0xA1};
}

/// Not interpolated: the factory's azimuth corrections, and KITTI's clouds, are for one azimuth per column.
ModelTable hdl64e(std::string_view name, std::span<const LaserRow> lasers) {
  return {.name = name,
          .lasers = lasers,
          .vertical_offset_across_beam = true,
          .firing_period_ns = {48'000, 57'600, 0},
          .firing_offset_ns = hdl64e_offset_ns,
          .flags = std::span(kBankFlags).first(2),
          .modes = kSingleOnly,
          .returns_by_bank = false};
}

ModelTable hdl64e_s1() {
  ModelTable table = hdl64e("HDL-64E-S1", hdl64e_s21_lasers());
  // About 2600 packets a second.
  table.firing_period_ns[0] = 64'100;
  table.has_clock = false;
  return table;
}

ModelTable hdl64e_s3() {
  ModelTable table = hdl64e("HDL-64E-S3", hdl64e_s3_lasers());
  table.modes = kSingleAndDual;
  table.measured_period = true;
  return table;
}

}  // namespace

ModelTable model_table(VelodyneModel model) {
  switch (model) {
    case VelodyneModel::kVlp16:
      break;
    case VelodyneModel::kPuckLite:
      return puck("Puck-LITE", vlp16_lasers(), 0x22);
    case VelodyneModel::kPuckHiRes:
      return puck("Puck-Hi-Res", puck_hi_res_lasers(), 0x24);
    case VelodyneModel::kHdl32e:
      return hdl32e();
    case VelodyneModel::kVlp32a:
      return vlp32("VLP-32A", vlp32a_lasers(), 0x23);
    case VelodyneModel::kVlp32b:
      return vlp32("VLP-32B", vlp32c_lasers(), 0x23);
    case VelodyneModel::kVlp32c:
      return vlp32("VLP-32C", vlp32c_lasers(), 0x28);
    case VelodyneModel::kVls128:
      return vls128();
    case VelodyneModel::kHdl64eS1:
      return hdl64e_s1();
    case VelodyneModel::kHdl64eS2:
      return hdl64e("HDL-64E-S2", hdl64e_kitti_lasers());
    case VelodyneModel::kHdl64eS21:
      return hdl64e("HDL-64E-S2.1", hdl64e_s21_lasers());
    case VelodyneModel::kHdl64eS3:
      return hdl64e_s3();
  }
  return puck("VLP-16", vlp16_lasers(), 0x22);
}

}  // namespace nilio::drivers
