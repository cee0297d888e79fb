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
/// spell clock, health and the unit's calibration.
///
/// From the manual (63-HDL64ES3, appendix E): cycles of 16 packets, H M S D N Y G T V and seven more; 260
/// cycles for all, the first spelling "UNIT#" and two thresholds, then for each laser three cycles of
/// calibration (21 bytes, low bytes first) and one of warnings, which the last laser lacks, then calibration
/// date, motor speed, field of view, life time, addresses, return mode, power level and a CRC. The CRC's
/// example there covers 20 bytes of each laser, without its id and with high bytes first.
///
/// Ours, for want of a recording: a CRC over the bytes in the order of the stream is accepted too; so are the
/// types '1' to '7' where the manual has special ones ('W' and F6 to FF), as older firmware may send them.
namespace nilio::drivers {

inline constexpr std::size_t kHdl64eLasers = 64;
inline constexpr std::size_t kHdl64eStatusCycle = 16;
inline constexpr std::size_t kHdl64eStatusCycles = 260;
/// Packets that carry one whole calibration, about 1.2 s.
inline constexpr std::size_t kHdl64eStatusPackets = kHdl64eStatusCycle * kHdl64eStatusCycles;
/// Of those the bytes that are not clock and health: seven per cycle.
inline constexpr std::size_t kHdl64eTableSize = 7 * kHdl64eStatusCycles;

/// What one packet carries.
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

/// What every cycle repeats.
struct Hdl64eReadings {
  /// The sensor's clock, whole seconds. UTC where `gps` says that it has the time; without GPS the clock
  /// starts at 2000-01-01 and drifts by seconds a day.
  std::optional<core::Time> clock;
  Hdl64eGps gps = Hdl64eGps::kUnknown;
  std::uint8_t temperature_degc = 0;
  /// 0x47 is version 4.07.
  std::uint8_t firmware = 0;
  /// Of the latest cycle that had them; only while the place in the table is known.
  std::uint8_t warnings = 0;

  friend bool operator==(const Hdl64eReadings&, const Hdl64eReadings&) = default;
};

enum class Hdl64eReturn : std::uint8_t { kStrongest = 0, kLast = 1, kBoth = 2, kUnknown = 0xFF };

/// Settings of the unit, sent with its calibration.
struct Hdl64eUnit {
  /// Noise thresholds of the two blocks of lasers.
  std::uint8_t upper_threshold = 0;
  std::uint8_t lower_threshold = 0;
  /// When the unit was calibrated; nothing where the bytes are no date.
  std::optional<core::Time> calibrated;
  /// Reserved for it, the manual says.
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
  /// The number 1820 (the table's size) instead, as S2 firmware sends it: nothing tells corrupted bytes.
  kNone,
};

/// A whole pass of the stream.
struct Hdl64eCalibration {
  /// By laser id; `ring` is not set, with_stream_calibration() does.
  std::array<LaserCalibration, kHdl64eLasers> lasers{};
  Hdl64eUnit unit;
  Hdl64eChecksum checksum = Hdl64eChecksum::kCrc;

  friend bool operator==(const Hdl64eCalibration&, const Hdl64eCalibration&) = default;
};

struct Hdl64eStatusCounters {
  std::uint64_t cycles = 0;       ///< whole cycles of 16
  std::uint64_t tables = 0;       ///< whole passes accepted
  std::uint64_t gaps = 0;         ///< the order was broken: packets lost, repeated or swapped
  std::uint64_t wrong_crc = 0;    ///< whole passes refused because of their CRC
  std::uint64_t implausible = 0;  ///< whole passes refused because no laser is like that

  friend bool operator==(const Hdl64eStatusCounters&, const Hdl64eStatusCounters&) = default;
};

/// CRC-16, polynomial 0x8005, initial value 0, highest bit first.
std::uint16_t hdl64e_crc(std::span<const std::uint8_t> bytes);

/// Puts the stream together again. One thread; does not allocate.
class Hdl64eStatusReader {
 public:
  /// Bytes 1204 and 1205 of the next packet.
  void add(std::uint8_t type, std::uint8_t value);
  /// Packets are known to be missing before the next add(). Without this call a loss shows by the order of
  /// the types, but one of a multiple of 16 packets only by the laser ids and the CRC.
  void note_loss();

  /// Of the latest cycle; nothing before the first.
  [[nodiscard]] const std::optional<Hdl64eReadings>& readings() const { return readings_; }
  /// Of the latest pass without a gap and with a right CRC; nothing before the first.
  [[nodiscard]] const std::optional<Hdl64eCalibration>& calibration() const { return calibration_; }
  [[nodiscard]] const Hdl64eStatusCounters& counters() const { return counters_; }

 private:
  void break_order();
  void finish_clock();
  void finish_cycle();
  void finish_table();

  /// Place in the cycle of the byte expected next; nothing until an 'H'.
  std::optional<std::size_t> position_;
  /// Cycle being received; nothing until a "UNIT#".
  std::optional<std::size_t> cycle_;
  std::array<std::uint8_t, kHdl64eStatusCycle> values_{};
  std::array<std::uint8_t, kHdl64eTableSize> table_{};
  std::optional<core::Time> previous_clock_;
  std::optional<Hdl64eReadings> readings_;
  std::optional<Hdl64eCalibration> calibration_;
  Hdl64eStatusCounters counters_;
};

/// Makes the stream of a unit.
class Hdl64eStatusWriter {
 public:
  /// Fails unless there are 64 lasers whose values fit the stream: steps of 0.01 degree, 1 mm and 0.1 (slope)
  /// in 16 bits.
  static core::Result<Hdl64eStatusWriter> create(std::span<const LaserCalibration> lasers,
                                                 const Hdl64eUnit& unit,
                                                 Hdl64eChecksum checksum = Hdl64eChecksum::kCrc);

  /// For the next packet; `now` is looked at once per cycle. A clock that is missing or not of 2000 to 2255
  /// is sent as 2000-01-01.
  Hdl64eStatusByte next(const Hdl64eReadings& now);

  /// What a reader gets: the calibration rounded to the steps of the stream.
  [[nodiscard]] const Hdl64eCalibration& calibration() const { return calibration_; }

 private:
  Hdl64eStatusWriter() = default;

  std::array<std::uint8_t, kHdl64eTableSize> table_{};
  Hdl64eCalibration calibration_;
  Hdl64eReadings now_;
  std::size_t packet_ = 0;
};

/// The sensor with the lasers that it sent itself. Fails for a sensor that has not 64 lasers.
core::Result<VelodyneSensor> with_stream_calibration(VelodyneSensor sensor,
                                                     const Hdl64eCalibration& calibration);

}  // namespace nilio::drivers
