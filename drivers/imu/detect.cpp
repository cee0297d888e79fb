#include "nilio/drivers/imu/detect.hpp"

#include <cmath>
#include <span>

namespace nilio::drivers {

namespace {

constexpr double kMinimumGravity = 7.0;
constexpr double kMaximumGravity = 13.0;
constexpr std::uint64_t kEnoughSamples = 500;
constexpr std::size_t kMostFrames = 200'000;
constexpr std::size_t kBatch = 256;

}  // namespace

bool is_plausible_imu(double mean_acceleration_m_s2) {
  return mean_acceleration_m_s2 > kMinimumGravity && mean_acceleration_m_s2 < kMaximumGravity;
}

ImuDetector::ImuDetector() {
  for (const std::string& name : imu_preset_names()) {
    const core::Result<ImuPreset> preset = imu_preset(name);
    if (!preset) continue;
    core::Result<ImuDecoder> decoder = ImuDecoder::create(preset->mapping, preset->database);
    if (decoder) candidates_.push_back({name, std::move(decoder).value()});
  }
}

void ImuDetector::add(const CanFrame& frame) {
  for (Candidate& candidate : candidates_) {
    const std::optional<core::ImuSample> sample = candidate.decoder.add(frame);
    if (!sample) continue;
    const auto& a = sample->linear_acceleration;
    candidate.acceleration_sum += std::hypot(a[0], a[1], a[2]);
  }
}

const ImuDetector::Candidate* ImuDetector::best() const {
  const Candidate* best = nullptr;
  for (const Candidate& candidate : candidates_) {
    const std::uint64_t samples = candidate.decoder.stats().samples;
    if (samples == 0 || !is_plausible_imu(candidate.acceleration_sum / static_cast<double>(samples)))
      continue;
    if (best == nullptr || samples > best->decoder.stats().samples) best = &candidate;
  }
  return best;
}

std::optional<std::string> ImuDetector::preset() const {
  const Candidate* const found = best();
  return found == nullptr ? std::nullopt : std::optional(found->name);
}

std::uint64_t ImuDetector::samples() const {
  const Candidate* const found = best();
  return found == nullptr ? 0 : found->decoder.stats().samples;
}

std::optional<std::string> detect_imu_preset(FrameSource& frames) {
  ImuDetector detector;
  std::vector<CanFrame> slots(kBatch);
  for (std::size_t seen = 0; seen < kMostFrames && detector.samples() < kEnoughSamples;) {
    const SourceRead read = frames.read(slots, core::Duration{});
    if (read.state != SourceState::kData) break;
    for (const CanFrame& frame : std::span(slots).first(read.count)) detector.add(frame);
    seen += read.count;
  }
  return detector.preset();
}

}  // namespace nilio::drivers
