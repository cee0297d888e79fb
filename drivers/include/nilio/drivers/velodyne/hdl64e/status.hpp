#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

/// The status stream of an HDL-64E: bytes 1204 (type) and 1205 (value) of successive data packets, which
/// together hold clock, health and the unit's calibration.
///
/// From the manual (63-HDL64ES3, appendix E): cycles of 16 packets, H M S D N Y G T V and seven more; 260
/// cycles in all. The first holds "UNIT#" and two thresholds; then come for each laser three cycles of
/// calibration (21 bytes, low bytes first) and one of warnings, which the last laser lacks; then calibration
/// date, motor speed, field of view, life time, addresses, return mode, power level and a CRC. The manual's
/// example of the CRC covers 20 bytes of each laser, without its id and with high bytes first.
///
/// Beyond the manual, for lack of a recording: a CRC over the bytes in stream order is also accepted, and so
/// are the types '1' to '7' in place of the special ones ('W' and F6 to FF), which older firmware may send.
namespace nilio::drivers {

inline constexpr std::size_t kHdl64eLasers = 64;
inline constexpr std::size_t kHdl64eStatusCycle = 16;
inline constexpr std::size_t kHdl64eStatusCycles = 260;
/// Packets that carry one whole calibration, about 1.2 s.
inline constexpr std::size_t kHdl64eStatusPackets = kHdl64eStatusCycle * kHdl64eStatusCycles;
/// Bytes of these packets other than clock and health: seven per cycle.
inline constexpr std::size_t kHdl64eTableSize = 7 * kHdl64eStatusCycles;

/// Status bytes of one packet.
struct Hdl64eStatusByte {
  std::uint8_t type = 0;
  std::uint8_t value = 0;

  friend bool operator==(const Hdl64eStatusByte&, const Hdl64eStatusByte&) = default;
};

enum class Hdl64eGps : std::uint8_t {
  kNone = 0,
  kPulseAndTime = 'A',
  kTimeOnly = 'V',
  kPulseOnly = 'P',
  kUnknown = 0xFF,
};

/// Bits of Hdl64eReadings::warnings.
inline constexpr std::uint8_t kHdl64eLensDirty = 1U << 0;
inline constexpr std::uint8_t kHdl64eTooHot = 1U << 1;
inline constexpr std::uint8_t kHdl64eTooCold = 1U << 2;
inline constexpr std::uint8_t kHdl64ePulse = 1U << 5;
inline constexpr std::uint8_t kHdl64eGpsTime = 1U << 6;

/// Values repeated in every cycle.
struct Hdl64eReadings {
  /// The sensor's clock, whole seconds. UTC where `gps` includes the time; without GPS the clock starts at
  /// 2000-01-01 and drifts by seconds a day.
  std::optional<core::Time> clock;
  Hdl64eGps gps = Hdl64eGps::kUnknown;
  std::uint8_t temperature_degc = 0;
  /// 0x47 is version 4.07.
  std::uint8_t firmware = 0;
  /// From the latest cycle with warnings; updated only while the position in the table is known.
  std::uint8_t warnings = 0;

  friend bool operator==(const Hdl64eReadings&, const Hdl64eReadings&) = default;
};

enum class Hdl64eReturn : std::uint8_t { kStrongest = 0, kLast = 1, kBoth = 2, kUnknown = 0xFF };

/// Settings of the unit, sent with its calibration.
struct Hdl64eUnit {
  /// Noise thresholds of the two blocks of lasers.
  std::uint8_t upper_threshold = 0;
  std::uint8_t lower_threshold = 0;
  /// Calibration date of the unit; nothing for invalid bytes.
  std::optional<core::Time> calibrated;
  /// Reserved by the manual.
  std::uint8_t humidity_percent = 0;
  std::int16_t motor_rpm = 0;
  /// In 0.01 degree.
  std::uint16_t field_of_view_start = 0;
  std::uint16_t field_of_view_end = 0;
  std::uint16_t life_hours = 0;
  /// IPv4, host byte order.
  std::uint32_t source_address = 0;
  std::uint32_t destination_address = 0;
  Hdl64eReturn returns = Hdl64eReturn::kUnknown;
  /// 0xA8 automatic with normalised intensities, 0xA0 automatic with raw ones, 0xn8 manual level n.
  std::uint8_t power_level = 0;

  friend bool operator==(const Hdl64eUnit&, const Hdl64eUnit&) = default;
};

enum class Hdl64eChecksum : std::uint8_t {
  kCrc,
  /// The number 1820 (the table's size) in its place, as S2 firmware sends: corruption cannot be detected.
  kNone,
};

/// One complete pass of the stream.
struct Hdl64eCalibration {
  /// By laser id; `ring` is not set, with_stream_calibration() does.
  std::array<LaserCalibration, kHdl64eLasers> lasers{};
  Hdl64eUnit unit;
  Hdl64eChecksum checksum = Hdl64eChecksum::kCrc;

  friend bool operator==(const Hdl64eCalibration&, const Hdl64eCalibration&) = default;
};

struct Hdl64eStatusCounters {
  std::uint64_t cycles = 0;       ///< complete cycles of 16
  std::uint64_t tables = 0;       ///< complete passes accepted
  std::uint64_t gaps = 0;         ///< the order was broken: packets lost, repeated or swapped
  std::uint64_t wrong_crc = 0;    ///< complete passes rejected for their CRC
  std::uint64_t implausible = 0;  ///< complete passes rejected for impossible laser geometry

  friend bool operator==(const Hdl64eStatusCounters&, const Hdl64eStatusCounters&) = default;
};

/// CRC-16, polynomial 0x8005, initial value 0, highest bit first.
std::uint16_t hdl64e_crc(std::span<const std::uint8_t> bytes);

/// Reassembles the stream. One thread; does not allocate.
class Hdl64eStatusReader {
 public:
  /// Bytes 1204 and 1205 of the next packet.
  void add(std::uint8_t type, std::uint8_t value);
  /// Call when packets are missing before the next add(). Without this call a loss is detected by the order
  /// of the types, but a loss of a multiple of 16 packets only by the laser ids and the CRC.
  void note_loss();

  /// Readings of the latest cycle; nothing before the first.
  [[nodiscard]] const std::optional<Hdl64eReadings>& readings() const { return readings_; }
  /// Calibration of the latest pass without a gap and with a correct CRC; nothing before the first.
  [[nodiscard]] const std::optional<Hdl64eCalibration>& calibration() const { return calibration_; }
  [[nodiscard]] const Hdl64eStatusCounters& counters() const { return counters_; }

 private:
  void break_order();
  void finish_clock();
  void finish_cycle();
  void finish_table();

  /// Position in the cycle of the next byte; unset until an 'H'.
  std::optional<std::size_t> position_;
  /// Cycle being received; unset until a "UNIT#".
  std::optional<std::size_t> cycle_;
  std::array<std::uint8_t, kHdl64eStatusCycle> values_{};
  std::array<std::uint8_t, kHdl64eTableSize> table_{};
  std::optional<core::Time> previous_clock_;
  std::optional<Hdl64eReadings> readings_;
  std::optional<Hdl64eCalibration> calibration_;
  Hdl64eStatusCounters counters_;
};

/// Generates the stream of a unit, for simulated sensors.
class Hdl64eStatusWriter {
 public:
  /// Fails unless there are 64 lasers whose values fit the stream: steps of 0.01 degree, 1 mm and 0.1 (slope)
  /// in 16 bits.
  static core::Result<Hdl64eStatusWriter> create(std::span<const LaserCalibration> lasers,
                                                 const Hdl64eUnit& unit,
                                                 Hdl64eChecksum checksum = Hdl64eChecksum::kCrc);

  /// Status bytes of the next packet; `now` is read once per cycle. A missing clock, or one outside 2000 to
  /// 2255, is sent as 2000-01-01.
  Hdl64eStatusByte next(const Hdl64eReadings& now);

  /// The calibration rounded to the steps of the stream, as a reader receives it.
  [[nodiscard]] const Hdl64eCalibration& calibration() const { return calibration_; }

 private:
  Hdl64eStatusWriter() = default;

  std::array<std::uint8_t, kHdl64eTableSize> table_{};
  Hdl64eCalibration calibration_;
  Hdl64eReadings now_;
  std::size_t packet_ = 0;
};

/// Replaces the sensor's lasers by those of its own stream. Fails for a sensor without 64 lasers.
core::Result<VelodyneSensor> with_stream_calibration(VelodyneSensor sensor,
                                                     const Hdl64eCalibration& calibration);

}  // namespace nilio::drivers
