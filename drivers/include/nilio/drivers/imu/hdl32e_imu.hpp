#pragma once

#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/imu/decoder.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"

#include <array>
#include <memory>
#include <optional>

namespace nilio::drivers {

/// Motion of an HDL-32E's base in the LiDAR's axes (x = azimuth 0, y = azimuth 270, z up). Each gyro's axis
/// is normal to its board: x for board 0, y for board 1, z for board 2. The two measurements of each
/// acceleration are averaged. Axes and signs were found by comparing recordings with registration.
core::ImuSample motion_of(const std::array<Hdl32eBoard, 3>& boards);
/// The inverse, for simulation.
std::array<Hdl32eBoard, 3> boards_of(const core::ImuSample& motion, double temperature_degc);

/// Samples of the gyros and accelerometers in an HDL-32E, from its position packets. These come in uneven
/// intervals of 1 to 10 ms, 200 a second; the samples are interpolated at even ones. The gyros' zero offsets
/// reach 30 degrees a second and are left in the samples. One thread; does not allocate.
class Hdl32eImu {
 public:
  Hdl32eImu();
  Hdl32eImu(Hdl32eImu&&) noexcept;
  Hdl32eImu& operator=(Hdl32eImu&&) noexcept;
  ~Hdl32eImu();

  /// Adds the motion of a position packet stamped `time`; then call take() until it returns nothing.
  void add(const std::array<Hdl32eBoard, 3>& boards, core::Time time);
  /// Next sample up to the last packet's time.
  std::optional<core::ImuSample> take();
  [[nodiscard]] const ImuDecoderStats& stats() const { return stats_; }

 private:
  struct Monitor;
  std::unique_ptr<Monitor> monitor_;
  ImuDecoderStats stats_;
  /// Motion of the last two packets, and the time of the next sample.
  std::optional<core::ImuSample> before_;
  std::optional<core::ImuSample> last_;
  core::Time next_;
};

}  // namespace nilio::drivers
