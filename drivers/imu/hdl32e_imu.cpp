#include "nilio/drivers/imu/hdl32e_imu.hpp"

#include "drivers/imu/sample_monitor.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace nilio::drivers {
namespace {

/// Mean interval of the packets.
constexpr core::Duration kInterval = core::Duration::from_milliseconds(5.0);
/// Three packets of the longest interval in recordings.
constexpr core::Duration kLongestInterval = core::Duration::from_milliseconds(30.0);

bool is_saturated(const Hdl32eBoard& board) {
  return std::abs(board.gyro_rad_s) >= kHdl32eGyroRange ||
         std::abs(board.acceleration_x_m_s2) >= kHdl32eAccelerationRange ||
         std::abs(board.acceleration_y_m_s2) >= kHdl32eAccelerationRange;
}

}  // namespace

core::ImuSample motion_of(const std::array<Hdl32eBoard, 3>& boards) {
  const auto& [across_x, across_y, flat] = boards;
  core::ImuSample sample;
  sample.angular_velocity = {across_x.gyro_rad_s, across_y.gyro_rad_s, flat.gyro_rad_s};
  sample.linear_acceleration = {-0.5 * (across_y.acceleration_y_m_s2 + flat.acceleration_y_m_s2),
                                0.5 * (across_x.acceleration_y_m_s2 - flat.acceleration_x_m_s2),
                                0.5 * (across_x.acceleration_x_m_s2 + across_y.acceleration_x_m_s2)};
  return sample;
}

std::array<Hdl32eBoard, 3> boards_of(const core::ImuSample& motion, double temperature_degc) {
  const auto& [rate_x, rate_y, rate_z] = motion.angular_velocity;
  const auto& [force_x, force_y, force_z] = motion.linear_acceleration;
  return {{{rate_x, temperature_degc, force_z, force_y},
           {rate_y, temperature_degc, force_z, -force_x},
           {rate_z, temperature_degc, -force_y, -force_x}}};
}

struct Hdl32eImu::Monitor {
  ImuSampleMonitor samples;
};

Hdl32eImu::Hdl32eImu() : monitor_(std::make_unique<Monitor>()) {}
Hdl32eImu::Hdl32eImu(Hdl32eImu&&) noexcept = default;
Hdl32eImu& Hdl32eImu::operator=(Hdl32eImu&&) noexcept = default;
Hdl32eImu::~Hdl32eImu() = default;

void Hdl32eImu::add(const std::array<Hdl32eBoard, 3>& boards, core::Time time) {
  ++stats_.frames;
  if (last_ && time <= last_->stamp) {
    ++stats_.out_of_order;
    return;
  }
  if (std::any_of(boards.begin(), boards.end(), is_saturated)) ++stats_.saturated;
  before_ = last_;
  last_ = motion_of(boards);
  last_->stamp = time;
  // Lost packets are not bridged by interpolation.
  if (before_ && time - before_->stamp <= kLongestInterval) return;
  before_ = last_;
  next_ = time;
}

std::optional<core::ImuSample> Hdl32eImu::take() {
  if (!last_ || next_ > last_->stamp) return std::nullopt;
  const auto interval = static_cast<double>((last_->stamp - before_->stamp).ns);
  const double share = interval > 0.0 ? static_cast<double>((next_ - before_->stamp).ns) / interval : 1.0;
  core::ImuSample sample;
  sample.stamp = next_;
  for (std::size_t i = 0; i < 3; ++i) {
    sample.angular_velocity[i] = std::lerp(before_->angular_velocity[i], last_->angular_velocity[i], share);
    sample.linear_acceleration[i] =
        std::lerp(before_->linear_acceleration[i], last_->linear_acceleration[i], share);
  }
  next_ = next_ + kInterval;
  ++stats_.samples;
  ++stats_.device_stamped;
  monitor_->samples.observe(sample, stats_);
  return sample;
}

}  // namespace nilio::drivers
