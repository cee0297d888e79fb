#include "nilio/drivers/velodyne/detect.hpp"

#include "drivers/common/byte_order.hpp"
#include "drivers/velodyne/packet_bytes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>

namespace nilio::drivers {
namespace {

constexpr double kPeriodTolerance = 0.05;
/// Share of equal time steps from which on the sensor has a clock.
constexpr double kRegularShare = 0.8;

struct Evidence {
  std::map<PacketShape, std::size_t> shapes;
  std::map<std::uint8_t, std::size_t> products;
  std::map<std::uint8_t, std::size_t> modes;
  std::size_t packets = 0;
  std::size_t paired = 0;
  std::size_t unpaired = 0;
  std::vector<std::uint32_t> steps_us;
};

template <class Key>
Key most_frequent(const std::map<Key, std::size_t>& counts) {
  return std::max_element(counts.begin(), counts.end(),
                          [](const auto& a, const auto& b) { return a.second < b.second; })
      ->first;
}

Evidence gather(std::span<const Packet> packets) {
  Evidence evidence;
  std::optional<std::uint32_t> previous_us;
  for (const Packet& packet : packets) {
    if (packet.size != kDataPacketSize || packet.truncated) continue;
    const std::span<const std::uint8_t> payload = std::span(packet.data).first(kDataPacketSize);
    ++evidence.packets;
    const PacketShape shape = packet_shape(payload);
    ++evidence.shapes[shape];
    ++evidence.products[payload[kProductOffset]];
    ++evidence.modes[payload[kReturnModeOffset]];
    const std::optional<bool> pairs = azimuths_in_pairs(payload, shape == PacketShape::kAlternating ? 2 : 1);
    evidence.paired += static_cast<std::size_t>(pairs == true);
    evidence.unpaired += static_cast<std::size_t>(pairs == false);
    const std::uint32_t now_us = load_le32(payload.data() + kTimestampOffset);
    if (previous_us && now_us > *previous_us) evidence.steps_us.push_back(now_us - *previous_us);
    previous_us = now_us;
  }
  return evidence;
}

/// Median step of the sensor's clock; 0 for uneven steps.
double period_of(Evidence& evidence) {
  std::vector<std::uint32_t>& steps = evidence.steps_us;
  if (steps.size() < 3) return 0.0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  const double median = *middle;
  const auto alike = std::count_if(steps.begin(), steps.end(), [&](std::uint32_t step) {
    return std::abs(step - median) <= 2.0 + 0.1 * median;
  });
  const bool regular =
      static_cast<double>(alike) >= kRegularShare * static_cast<double>(evidence.packets - 1);
  return regular ? median : 0.0;
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

void detect_one_bank(const Evidence& evidence, VelodyneDetection& result) {
  const std::uint8_t product = most_frequent(evidence.products);
  const std::vector<VelodyneModel> named = models_of_product(product);
  result.mode = evidence.paired > evidence.unpaired ? ReturnMode::kDual : ReturnMode::kSingle;
  if (result.packet_period_us == 0.0) {
    result.candidates = named;
  } else {
    for (const VelodyneModel model : named) {
      if (has_period(model, result.mode, result.packet_period_us)) result.candidates.push_back(model);
    }
    if (result.candidates.empty()) result.candidates = models_of_period(result.mode, result.packet_period_us);
  }
  const bool ambiguous = !result.candidates.empty() && result.candidates.front() == VelodyneModel::kVlp32a;
  if (!result.candidates.empty() && !ambiguous) result.model = result.candidates.front();
}

void detect_hdl64e(const Evidence& evidence, VelodyneDetection& result) {
  using enum VelodyneModel;
  if (evidence.paired > evidence.unpaired) {
    result.mode = ReturnMode::kDual;
    result.candidates = {kHdl64eS3};
  } else if (result.packet_period_us == 0.0) {
    result.candidates = {kHdl64eS1, kHdl64eS2, kHdl64eS21, kHdl64eS3};
    // Too few packets to detect whether the sensor has a clock.
    if (evidence.packets < 8) return;
  } else {
    result.candidates = {kHdl64eS2, kHdl64eS21, kHdl64eS3};
    if (!has_period(kHdl64eS2, ReturnMode::kSingle, result.packet_period_us)) result.candidates = {kHdl64eS3};
  }
  result.model = result.candidates.front();
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
  Evidence evidence = gather(packets);
  if (evidence.packets == 0) {
    result.evidence = "no data packets of " + std::to_string(kDataPacketSize) + " bytes";
    return result;
  }
  result.packet_period_us = period_of(evidence);
  const PacketShape shape = most_frequent(evidence.shapes);
  switch (shape) {
    case PacketShape::kUpperOnly:
      detect_one_bank(evidence, result);
      break;
    case PacketShape::kAlternating:
      detect_hdl64e(evidence, result);
      break;
    case PacketShape::kFourBanks:
    case PacketShape::kFourBanksTwice:
    case PacketShape::kFourBanksThrice:
      result.mode = shape == PacketShape::kFourBanks        ? ReturnMode::kSingle
                    : shape == PacketShape::kFourBanksTwice ? ReturnMode::kDual
                                                            : ReturnMode::kDualConfidence;
      result.candidates = {VelodyneModel::kVls128};
      result.model = VelodyneModel::kVls128;
      break;
    case PacketShape::kOther:
      break;
  }
  result.evidence = describe(evidence, result, shape);
  return result;
}

}  // namespace nilio::drivers
