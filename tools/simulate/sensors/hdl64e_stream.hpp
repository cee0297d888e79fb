#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tools/simulate/sensors/sensor_timing.hpp"

#include <array>
#include <cstdint>
#include <optional>

namespace nilio::tools::simulate {

/// Status bytes of an HDL-64E's packets, for packets in any order. Immutable.
class Hdl64eStream {
 public:
  /// Clock and health only; the bytes of the unit's calibration are zero.
  explicit Hdl64eStream(GpsReception gps);
  /// With the calibration of `sensor`; fails for a sensor that is not an HDL-64E.
  static core::Result<Hdl64eStream> with_calibration(const drivers::VelodyneSensor& sensor,
                                                     drivers::ReturnMode mode, double revolutions_per_minute,
                                                     GpsReception gps);

  /// The calibration that is sent, rounded to the stream's steps; unset when none is.
  [[nodiscard]] const std::optional<drivers::Hdl64eCalibration>& calibration() const { return calibration_; }
  /// Bytes of a packet. `clock`: sensor time of the first packet of the cycle, see cycle_start().
  [[nodiscard]] drivers::Hdl64eStatusByte at(std::uint64_t packet, core::Time clock) const;
  [[nodiscard]] static std::uint64_t cycle_start(std::uint64_t packet) {
    return packet - packet % drivers::kHdl64eStatusCycle;
  }

 private:
  Hdl64eStream(GpsReception gps, drivers::Hdl64eStatusWriter writer);

  GpsReception gps_;
  /// State at the first packet of a pass.
  drivers::Hdl64eStatusWriter writer_;
  std::array<drivers::Hdl64eStatusByte, drivers::kHdl64eStatusPackets> pass_{};
  std::optional<drivers::Hdl64eCalibration> calibration_;
};

/// True for an HDL-64E from S2 on: an S1 sends neither time nor status.
bool has_status_stream(drivers::VelodyneModel model);

}  // namespace nilio::tools::simulate
