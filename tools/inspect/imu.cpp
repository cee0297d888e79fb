#include "tools/inspect/imu.hpp"

#include "nilio/drivers/imu/detect.hpp"

#include <cmath>
#include <numbers>
#include <utility>

namespace nilio::tools::inspect {

namespace {

constexpr core::Duration kWindow{1'000'000'000};
constexpr std::uint64_t kMinimumSamples = 10;
/// Above an idling engine's vibration, below a driving vehicle's.
constexpr double kStillGyroDeviation = 0.02;
constexpr double kLargestHdl32eBias = 0.6;
constexpr double kStillAccelerationDeviation = 0.3;

}  // namespace

bool ImuFindings::plausible() const { return drivers::is_plausible_imu(acceleration_m_s2.mean()); }

double ImuFindings::rate_hz() const {
  const double duration = (last - first).seconds();
  return stats.samples > 1 && duration > 0.0 ? static_cast<double>(stats.samples - 1) / duration : 0.0;
}

std::optional<double> ImuFindings::tilt_deg() const {
  const auto& axes = still_seconds > 0 ? still_linear_acceleration : linear_acceleration;
  const double across = std::hypot(axes[0].mean(), axes[1].mean());
  if (across == 0.0 && axes[2].mean() == 0.0) return std::nullopt;
  return std::atan2(across, axes[2].mean()) * 180.0 / std::numbers::pi;
}

core::Result<ImuInspector> ImuInspector::create(const std::string& preset,
                                                const std::string& interface_name) {
  const core::Result<drivers::ImuPreset> found = drivers::imu_preset(preset);
  if (!found) return found.error();
  core::Result<drivers::ImuDecoder> decoder = drivers::ImuDecoder::create(found->mapping, found->database);
  if (!decoder) return decoder.error();
  ImuInspector inspector;
  inspector.decoder_.emplace(std::move(decoder).value());
  inspector.findings_.preset = preset;
  inspector.findings_.interface_name = interface_name;
  return inspector;
}

ImuInspector ImuInspector::of_hdl32e() {
  ImuInspector inspector;
  inspector.largest_bias_ = kLargestHdl32eBias;
  inspector.findings_.preset = "hdl32e";
  inspector.findings_.interface_name = "its position packets";
  return inspector;
}

void ImuInspector::add(const drivers::CanFrame& frame) {
  if (!decoder_) return;
  if (const auto sample = decoder_->add(frame)) add(*sample);
}

void ImuInspector::add(const core::ImuSample& sample) {
  if (findings_.acceleration_m_s2.empty()) {
    findings_.first = sample.stamp;
    window_.start = sample.stamp;
  } else {
    findings_.interval_s.add((sample.stamp - findings_.last).seconds());
  }
  findings_.last = sample.stamp;
  const auto& a = sample.linear_acceleration;
  findings_.acceleration_m_s2.add(std::hypot(a[0], a[1], a[2]));
  if (sample.stamp - window_.start >= kWindow) {
    close_window();
    window_ = Window{.start = sample.stamp, .angular_velocity = {}, .linear_acceleration = {}};
  }
  for (std::size_t i = 0; i < 3; ++i) {
    findings_.angular_velocity[i].add(sample.angular_velocity[i]);
    findings_.linear_acceleration[i].add(a[i]);
    window_.angular_velocity[i].add(sample.angular_velocity[i]);
    window_.linear_acceleration[i].add(a[i]);
  }
}

void ImuInspector::close_window() {
  if (window_.angular_velocity[0].count() < kMinimumSamples) return;
  for (std::size_t i = 0; i < 3; ++i) {
    if (window_.angular_velocity[i].standard_deviation() > kStillGyroDeviation) return;
    if (std::abs(window_.angular_velocity[i].mean()) > largest_bias_) return;
    if (window_.linear_acceleration[i].standard_deviation() > kStillAccelerationDeviation) return;
  }
  ++findings_.still_seconds;
  for (std::size_t i = 0; i < 3; ++i) {
    findings_.still_angular_velocity[i].add(window_.angular_velocity[i].mean());
    findings_.still_linear_acceleration[i].add(window_.linear_acceleration[i].mean());
  }
}

ImuFindings ImuInspector::finish() {
  if (decoder_) {
    findings_.stats = decoder_->stats();
  } else {
    findings_.stats.samples = findings_.acceleration_m_s2.count();
  }
  return std::move(findings_);
}

}  // namespace nilio::tools::inspect
