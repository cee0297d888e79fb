// Input as position packets and NMEA sentences.

#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"

#include "tests/fuzz/fuzz_support.hpp"

#include <cmath>
#include <string_view>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace nilio;
  const std::span<const std::uint8_t> bytes(data, size);
  const std::optional<drivers::PositionPacket> packet = drivers::parse_position_packet(bytes);
  fuzz::require(packet.has_value() == (size == drivers::kPositionPacketSize),
                "position packets have 512 bytes");
  std::string_view sentence(reinterpret_cast<const char*>(data), size);
  if (packet) {
    const auto again = drivers::parse_position_packet(drivers::encode_position_packet(*packet));
    fuzz::require(again == packet, "encoding is the inverse of parsing");
    sentence = packet->nmea();
    fuzz::require(sentence.size() <= drivers::kNmeaCapacity, "a sentence is within its field");
  }
  const std::optional<drivers::NmeaFix> fix =
      drivers::parse_nmea(sentence, core::Time{1'700'000'000'000'000'000});
  if (!fix) return 0;
  if (fix->time_of_day)
    fuzz::require(fix->time_of_day->ns >= 0 && fix->time_of_day->seconds() < 86'401.0,
                  "a time is within a day");
  for (const std::optional<double>& number :
       {fix->latitude_deg, fix->longitude_deg, fix->speed_m_s, fix->course_deg, fix->altitude_m})
    fuzz::require(!number || std::isfinite(*number), "numbers are finite");
  return 0;
}
