#pragma once

#include "core/src/imu_monitor/gyro_alignment.hpp"
#include "core/src/imu_monitor/imu_monitor.hpp"

namespace nilio::core {

/// Sets a value and evaluates it against the table's thresholds with hysteresis: a row becomes worse above a
/// threshold and better only well below it. Distances within three standard deviations count as zero.
void set_row(ImuHealth& health, ImuCheck check, double value, double sigma = 0.0);
/// Sets a row that is bad whenever its value is not 0.
void set_flag_row(ImuHealth& health, ImuCheck check, double value);
/// Marks the value as unknown.
void clear_row(ImuHealth& health, ImuCheck check);

/// Fills axes, mounting and scale from the observed directions.
void fill_directions(const GyroAlignmentEstimate& estimate, ImuHealth& health);

/// The bad row that forbids using the gyro, causes before consequences; kCount = none.
ImuCheck find_obstacle(const ImuHealth& health);

}  // namespace nilio::core
