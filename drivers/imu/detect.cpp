#include "nilio/drivers/imu/detect.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <utility>

namespace nilio::drivers {

namespace {

constexpr double kMinimumGravity = 7.0;
constexpr double kMaximumGravity = 13.0;
constexpr double kEnoughSeconds = 1.0;
/// Logs without times have no seconds.
constexpr std::uint64_t kEnoughSamples = 500;
/// Two seconds of the fastest IMU.
constexpr std::size_t kBufferedSamples = 2048;
constexpr std::size_t kBatch = 256;

}  // namespace

bool is_plausible_imu(double mean_acceleration_m_s2) {
  return mean_acceleration_m_s2 > kMinimumGravity && mean_acceleration_m_s2 < kMaximumGravity;
}

std::vector<ImuCandidate> imu_candidates() {
  std::vector<ImuCandidate> candidates;
  for (const std::string& name : imu_preset_names()) {
    const core::Result<ImuPreset> preset = imu_preset(name);
    if (!preset) continue;
    core::Result<ImuDecoder> decoder = ImuDecoder::create(preset->mapping, preset->database);
    if (decoder) candidates.push_back({name, std::move(decoder).value()});
  }
  return candidates;
}

std::string IdentifiedImu::text() const {
  std::array<char, 96> numbers{};
  std::snprintf(numbers.data(), numbers.size(), "%llu samples in %.1f s, specific force %.2f m/s^2",
                static_cast<unsigned long long>(samples), seconds, acceleration_m_s2);
  return "identified by frames " + identifiers + ": " + numbers.data();
}

ImuIdentification::ImuIdentification(std::vector<ImuCandidate> candidates) {
  candidates_.reserve(candidates.size());
  for (ImuCandidate& candidate : candidates) {
    Candidate added{std::move(candidate.decoder)};
    added.summary.preset = std::move(candidate.preset);
    added.summary.identifiers = added.decoder.frame_filter().text();
    added.summary.taken_as_zero = added.decoder.taken_as_zero();
    added.buffer.reserve(kBufferedSamples);
    candidates_.push_back(std::move(added));
  }
}

void ImuIdentification::take_sample(Candidate& candidate, const core::ImuSample& sample,
                                    std::int64_t received_ns) {
  IdentifiedImu& summary = candidate.summary;
  if (summary.samples++ == 0) candidate.first = sample.stamp;
  const auto& a = sample.linear_acceleration;
  candidate.acceleration_sum += std::hypot(a[0], a[1], a[2]);
  summary.acceleration_m_s2 = candidate.acceleration_sum / static_cast<double>(summary.samples);
  summary.seconds = (sample.stamp - candidate.first).seconds();
  std::vector<ReceivedSample>& buffer = candidate.buffer;
  if (buffer.size() == kBufferedSamples) {
    // The oldest half at once: samples are moved rarely.
    constexpr std::size_t dropped = kBufferedSamples / 2;
    buffer.erase(buffer.begin(), buffer.begin() + dropped);
    candidate.lost += dropped;
  }
  buffer.push_back({sample, received_ns});
}

bool ImuIdentification::add(const CanFrame& frame) {
  for (Candidate& candidate : candidates_) {
    if (const auto sample = candidate.decoder.add(frame)) take_sample(candidate, *sample, frame.received_ns);
  }
  Candidate* const found = best(true);
  if (found == nullptr) return false;
  if (found->summary.seconds < kEnoughSeconds && found->summary.samples < kEnoughSamples) return false;
  decide(*found);
  return true;
}

const IdentifiedImu* ImuIdentification::identify(FrameSource& frames) {
  const auto slots = std::make_unique<std::array<CanFrame, kBatch>>();
  for (;;) {
    const SourceRead read = frames.read(*slots, core::Duration{});
    for (const CanFrame& frame : std::span(*slots).first(read.count)) {
      if (add(frame)) return result();
    }
    if (read.state != SourceState::kData) break;
  }
  Candidate* found = best(true);
  if (found == nullptr) found = best(false);
  if (found != nullptr) decide(*found);
  return result();
}

ImuIdentification::Candidate* ImuIdentification::best(bool plausible) {
  Candidate* best = nullptr;
  for (Candidate& candidate : candidates_) {
    const IdentifiedImu& summary = candidate.summary;
    if (summary.samples == 0 || (plausible && !summary.is_plausible())) continue;
    if (best == nullptr || summary.samples > best->summary.samples) best = &candidate;
  }
  return best;
}

void ImuIdentification::decide(Candidate& candidate) {
  chosen_ = &candidate;
  result_.store(&candidate.summary, std::memory_order_release);
}

ImuDecoder ImuIdentification::take_decoder() { return std::move(chosen_->decoder); }

std::span<const ReceivedSample> ImuIdentification::samples() const { return chosen_->buffer; }

std::uint64_t ImuIdentification::samples_lost() const { return chosen_->lost; }

ImuFrameFilter ImuIdentification::frame_filter() const {
  ImuFrameFilter filter({});
  for (const Candidate& candidate : candidates_) filter.merge(candidate.decoder.frame_filter());
  return filter;
}

}  // namespace nilio::drivers
