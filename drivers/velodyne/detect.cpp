#include "nilio/drivers/velodyne/detect.hpp"

#include "drivers/velodyne/packet_bytes.hpp"
#include "drivers/velodyne/packet_sample.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

namespace nilio::drivers {
namespace {

/// Between the nearest periods of two models, 48.0 and 57.6 us an azimuth step, lie 20 per cent.
constexpr double kPeriodTolerance = 0.05;
/// Of a sensor without a clock no stamp agrees with another; fewer packets may be a coincidence.
constexpr std::size_t kPacketsWithoutClock = 8;

struct Evidence {
  std::map<PacketShape, std::size_t> shapes;
  std::map<std::uint8_t, std::size_t> products;
  std::map<std::uint8_t, std::size_t> modes;
  std::size_t paired = 0;
  std::size_t unpaired = 0;
};

template <class Key>
Key most_frequent(const std::map<Key, std::size_t>& counts) {
  return std::max_element(counts.begin(), counts.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

Evidence gather(const PacketSample& sample) {
  Evidence evidence;
  for (std::size_t i = 0; i < sample.packets.size(); ++i) {
    const std::span<const std::uint8_t> payload = sample.payload(i);
    const PacketShape shape = packet_shape(payload);
    ++evidence.shapes[shape];
    ++evidence.products[payload[kProductOffset]];
    ++evidence.modes[payload[kReturnModeOffset]];
    const std::optional<bool> pairs = azimuths_in_pairs(payload, shape == PacketShape::kAlternating ? 2 : 1);
    evidence.paired += static_cast<std::size_t>(pairs == true);
    evidence.unpaired += static_cast<std::size_t>(pairs == false);
  }
  return evidence;
}

void set_mode_by_pairs(const Evidence& evidence, VelodyneDetection& result) {
  result.mode = evidence.paired > evidence.unpaired ? ReturnMode::kDual : ReturnMode::kSingle;
  result.mode_known = evidence.paired != evidence.unpaired;
}

/// By the azimuth steps, otherwise (motor stopped) by the packets alone; 0 when neither is even.
double packet_period_us(const PacketSample& sample, std::size_t blocks_per_step) {
  const double step_us = azimuth_step_us(sample, blocks_per_step);
  const std::size_t steps = kBlocksPerPacket / blocks_per_step;
  if (step_us > 0.0) return step_us * static_cast<double>(steps);
  return regular_packet_period_us(sample);
}

bool has_period(VelodyneModel model, ReturnMode mode, double period_us) {
  const VelodyneSensor sensor = make_velodyne_sensor(model);
  const PacketLayout* layout = sensor.layout(mode);
  if (layout == nullptr) return false;
  const double expected_us = static_cast<double>(layout->packet_period_ns) * 1e-3;
  return std::abs(period_us - expected_us) < kPeriodTolerance * expected_us;
}

/// Models of up to 32 lasers, by product byte (VLP manuals, "factory bytes").
std::vector<VelodyneModel> models_of_product(std::uint8_t product) {
  switch (product) {
    case 0x21:
      return {VelodyneModel::kHdl32e};
    case 0x22:
      return {VelodyneModel::kVlp16, VelodyneModel::kPuckLite};
    case 0x23:
      return {VelodyneModel::kVlp32a, VelodyneModel::kVlp32b};
    case 0x24:
      return {VelodyneModel::kPuckHiRes};
    case 0x28:
      return {VelodyneModel::kVlp32c};
    default:
      return {};
  }
}

std::vector<VelodyneModel> models_of_period(ReturnMode mode, double period_us) {
  std::vector<VelodyneModel> models;
  for (const VelodyneModel model :
       {VelodyneModel::kVlp16, VelodyneModel::kPuckLite, VelodyneModel::kPuckHiRes, VelodyneModel::kHdl32e,
        VelodyneModel::kVlp32c, VelodyneModel::kVlp32b, VelodyneModel::kVlp32a}) {
    if (has_period(model, mode, period_us)) models.push_back(model);
  }
  return models;
}

void detect_one_bank(const PacketSample& sample, const Evidence& evidence, VelodyneDetection& result) {
  const std::vector<VelodyneModel> named = models_of_product(most_frequent(evidence.products));
  set_mode_by_pairs(evidence, result);
  result.packet_period_us = packet_period_us(sample, result.mode == ReturnMode::kDual ? 2 : 1);
  if (result.packet_period_us == 0.0) {
    result.candidates = named;
    result.uncertainty = "the product byte alone is not reliable";
  } else {
    for (const VelodyneModel model : named) {
      if (has_period(model, result.mode, result.packet_period_us)) result.candidates.push_back(model);
    }
    if (result.candidates.empty()) {
      result.candidates = models_of_period(result.mode, result.packet_period_us);
      result.uncertainty = "the product byte is of another model or of none";
    }
  }
  const bool ambiguous = !result.candidates.empty() && result.candidates.front() == VelodyneModel::kVlp32a;
  if (!result.candidates.empty() && !ambiguous) result.model = result.candidates.front();
}

void detect_hdl64e(const PacketSample& sample, const Evidence& evidence, VelodyneDetection& result) {
  using enum VelodyneModel;
  set_mode_by_pairs(evidence, result);
  result.packet_period_us = packet_period_us(sample, result.mode == ReturnMode::kDual ? 4 : 2);
  // Only the S3 has two returns, or another period.
  const bool is_s3 =
      result.mode == ReturnMode::kDual ||
      (result.packet_period_us > 0.0 && !has_period(kHdl64eS2, ReturnMode::kSingle, result.packet_period_us));
  if (is_s3) {
    result.candidates = {kHdl64eS3};
  } else if (!sample.ticks || (!*sample.ticks && sample.packets.size() < kPacketsWithoutClock)) {
    result.candidates = {kHdl64eS1, kHdl64eS2, kHdl64eS21, kHdl64eS3};
    return;
  } else if (!*sample.ticks) {
    result.candidates = {kHdl64eS1};
  } else {
    result.candidates = {kHdl64eS2, kHdl64eS21, kHdl64eS3};
    result.uncertainty = "they send the same packets and differ in their calibration only";
  }
  result.model = result.candidates.front();
}

void detect_vls128(const PacketSample& sample, PacketShape shape, VelodyneDetection& result) {
  const bool single = shape == PacketShape::kFourBanks;
  result.mode = single                                  ? ReturnMode::kSingle
                : shape == PacketShape::kFourBanksTwice ? ReturnMode::kDual
                                                        : ReturnMode::kDualConfidence;
  result.mode_known = true;
  result.packet_period_us = packet_period_us(sample, single ? 4 : kBlocksPerPacket);
  result.candidates = {VelodyneModel::kVls128};
  result.model = VelodyneModel::kVls128;
}

std::string describe(const Evidence& evidence, const VelodyneDetection& result, PacketShape shape) {
  std::array<char, 128> text{};
  const int length = std::snprintf(text.data(), text.size(), "factory bytes 0x%02X 0x%02X, ",
                                   most_frequent(evidence.modes), most_frequent(evidence.products));
  std::string out = shape == PacketShape::kAlternating
                        ? "a status stream in the factory bytes, "
                        : std::string(text.data(), static_cast<std::size_t>(length));
  out += shape == PacketShape::kUpperOnly     ? "one bank of lasers"
         : shape == PacketShape::kAlternating ? "two banks of lasers"
         : shape == PacketShape::kOther       ? "block flags of no known model"
                                              : "four banks of lasers";
  if (result.packet_period_us > 0.0) {
    std::snprintf(text.data(), text.size(), ", a packet every %.0f us", result.packet_period_us);
    return out + text.data();
  }
  return out + ", no even time from packet to packet";
}

}  // namespace

bool VelodyneDetection::agrees_with(VelodyneModel wanted) const {
  return std::find(candidates.begin(), candidates.end(), wanted) != candidates.end();
}

VelodyneDetection detect_velodyne(std::span<const Packet> packets) {
  VelodyneDetection result;
  const PacketSample sample = make_sample(packets);
  if (sample.packets.empty()) {
    result.evidence = "no data packets of " + std::to_string(kDataPacketSize) + " bytes";
    return result;
  }
  const Evidence evidence = gather(sample);
  const PacketShape shape = most_frequent(evidence.shapes);
  switch (shape) {
    case PacketShape::kUpperOnly:
      detect_one_bank(sample, evidence, result);
      break;
    case PacketShape::kAlternating:
      detect_hdl64e(sample, evidence, result);
      break;
    case PacketShape::kFourBanks:
    case PacketShape::kFourBanksTwice:
    case PacketShape::kFourBanksThrice:
      detect_vls128(sample, shape, result);
      break;
    case PacketShape::kOther:
      break;
  }
  result.evidence = describe(evidence, result, shape);
  return result;
}

}  // namespace nilio::drivers
