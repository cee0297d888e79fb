#pragma once

#include "core/src/imu_monitor/gyro_alignment.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"

namespace nilio::core {

/// Puts a value into its row and judges it by the table's thresholds, with hysteresis: a row becomes worse
/// above a threshold and better only well below it. What three standard deviations explain counts as nothing.
void set_row(ImuHealth& health, ImuCheck check, double value, double sigma = 0.0);
/// For rows whose value is 0 while all is well and whose size says nothing.
void set_flag_row(ImuHealth& health, ImuCheck check, double value);
/// The value is not known any more.
void forget_row(ImuHealth& health, ImuCheck check);

/// Axes, mounting and scale from the observed directions.
void fill_directions(const RotationEstimate& estimate, ImuHealth& health);

/// The bad row because of which the gyro must not be used, the cause before its consequences; kCount = none.
ImuCheck find_obstacle(const ImuHealth& health);

}  // namespace nilio::core
