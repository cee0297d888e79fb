#include "tools/simulate/sensors/position_model.hpp"

#include "nilio/core/units.hpp"
#include "nilio/drivers/imu/hdl32e_imu.hpp"

#include "tools/simulate/sensors/imu_model.hpp"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <string_view>

namespace nilio::tools::simulate {

namespace {

constexpr double kMetresPerSecondPerKnot = 0.514444;
/// Delay of a receiver's sentence after its pulse.
constexpr core::Duration kSentenceDelay{300'000'000};
/// Origin of the world; x is east and y is north.
constexpr double kLatitudeDeg = 49.011;
constexpr double kLongitudeDeg = 8.416;
constexpr double kEarthRadiusM = 6'378'137.0;
constexpr std::uint8_t kTemperatureDegc = 45;

/// Degrees and minutes as NMEA has them: dddmm.mmmmm.
double degrees_minutes(double degrees) {
  const double whole = std::floor(degrees);
  return 100.0 * whole + 60.0 * (degrees - whole);
}

std::string with_checksum(std::string_view body) {
  unsigned sum = 0;
  for (const char c : body) sum ^= static_cast<unsigned char>(c);
  std::array<char, 8> tail{};
  std::snprintf(tail.data(), tail.size(), "*%02X\r\n", sum & 0xFFU);
  return "$" + std::string(body) + tail.data();
}

}  // namespace

bool sends_position_packets(drivers::VelodyneModel model) {
  using enum drivers::VelodyneModel;
  return model != kHdl64eS1 && model != kHdl64eS2 && model != kHdl64eS21 && model != kHdl64eS3;
}

std::string format_rmc(const RmcFields& fields) {
  using namespace std::chrono;
  const sys_seconds second{floor<seconds>(nanoseconds{fields.utc.ns})};
  const sys_days day = floor<days>(second);
  const year_month_day date{day};
  const hh_mm_ss clock{second - day};
  std::array<char, drivers::kNmeaCapacity> body{};
  std::snprintf(body.data(), body.size(),
                "GPRMC,%02d%02d%02d,A,%010.5f,%c,%011.5f,%c,%05.1f,%05.1f,%02u%02u%02d,,,A",
                static_cast<int>(clock.hours().count()), static_cast<int>(clock.minutes().count()),
                static_cast<int>(clock.seconds().count()), degrees_minutes(std::abs(fields.latitude_deg)),
                fields.latitude_deg < 0.0 ? 'S' : 'N', degrees_minutes(std::abs(fields.longitude_deg)),
                fields.longitude_deg < 0.0 ? 'W' : 'E', fields.speed_m_s / kMetresPerSecondPerKnot,
                fields.course_deg, static_cast<unsigned>(date.day()), static_cast<unsigned>(date.month()),
                static_cast<int>(date.year()) % 100);
  return with_checksum(body.data());
}

PositionModel::PositionModel(drivers::VelodyneModel model, GpsReception gps, const core::SE3& T_base_lidar,
                             const SensorTiming& timing, const VehicleTrajectory& trajectory)
    : model_(model), gps_(gps), T_base_lidar_(T_base_lidar), timing_(timing), trajectory_(trajectory) {}

SimulatedPosition PositionModel::make_packet(std::uint64_t index) const {
  const std::uint64_t after = index * kDataPacketsPerPosition;
  const core::Duration time = timing_.last_firing(after) + timing_.packet_period() / 2;
  drivers::PositionPacket packet;
  packet.timestamp_us = timestamp_us(timing_.sensor_clock_at(time));
  packet.pps = gps_ == GpsReception::kLocked ? drivers::PpsState::kLocked : drivers::PpsState::kAbsent;
  packet.health.top_board_degc = kTemperatureDegc;
  packet.health.bottom_board_degc = kTemperatureDegc;
  packet.health.adc_calibration_degc = kTemperatureDegc;
  packet.health.power_up_degc = kTemperatureDegc / 2;
  if (gps_ != GpsReception::kNone) packet.set_nmea(sentence(time));
  if (model_ == drivers::VelodyneModel::kHdl32e) packet.motion = boards(time);
  SimulatedPosition result;
  // It waits for the preceding data packet.
  result.stamp = std::max(timing_.config().start + time + kTransmission, timing_.received(after));
  result.payload = drivers::encode_position_packet(packet);
  return result;
}

/// Sentence of the last reported pulse. With a pulse the sensor's clock is the receiver's, else the receiver
/// is exact.
std::string PositionModel::sentence(core::Duration time) const {
  const core::Time utc =
      (gps_ == GpsReception::kLocked ? timing_.sensor_clock_at(time) : timing_.config().start + time) -
      kSentenceDelay;
  const MotionState motion = trajectory_.state((time - kSentenceDelay).seconds());
  const core::Vector3& place = motion.T_world_base.translation;
  RmcFields fields;
  fields.utc = core::Time{utc.ns - utc.ns % kNanosecondsPerSecond};
  fields.latitude_deg = kLatitudeDeg + place.y() / kEarthRadiusM * kDegreesPerRadian;
  fields.longitude_deg = kLongitudeDeg + place.x() /
                                             (kEarthRadiusM * std::cos(kLatitudeDeg / kDegreesPerRadian)) *
                                             kDegreesPerRadian;
  fields.speed_m_s = motion.velocity.head<2>().norm();
  const double course = std::atan2(motion.velocity.x(), motion.velocity.y()) * kDegreesPerRadian;
  fields.course_deg = course < 0.0 ? course + 360.0 : course;
  return format_rmc(fields);
}

std::array<drivers::Hdl32eBoard, 3> PositionModel::boards(core::Duration time) const {
  const TrueInertia truth = true_inertia(trajectory_, T_base_lidar_, time.seconds());
  core::ImuSample motion;
  for (Eigen::Index i = 0; i < 3; ++i) {
    motion.angular_velocity[static_cast<std::size_t>(i)] = truth.angular_velocity[i];
    motion.linear_acceleration[static_cast<std::size_t>(i)] = truth.specific_force[i];
  }
  return drivers::boards_of(motion, kTemperatureDegc);
}

}  // namespace nilio::tools::simulate
