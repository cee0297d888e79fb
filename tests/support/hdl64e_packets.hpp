#pragma once

#include "nilio/drivers/velodyne/hdl64e/status.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tests/support/hdl64e_support.hpp"

#include <cstddef>
#include <vector>

namespace nilio::tests {

/// Content of the status stream of a simulated HDL-64E.
enum class StatusStream {
  kWhole,
  kWithoutTable,   ///< clock and health only; the bytes of the table are 0
  kWrongChecksum,  ///< one byte of each pass is damaged
};

/// Packets of a rotating HDL-64E S2; the first one is packet `first` of a pass of its status stream.
inline std::vector<drivers::Packet> hdl64e_packets(std::size_t count, StatusStream kind,
                                                   std::size_t first = 0) {
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kHdl64eS2);
  turning.start_azimuth_deg = 180.0;
  auto pass = one_pass(make_writer());
  for (std::size_t i = 0; i < pass.size(); ++i) {
    const bool is_table = i % drivers::kHdl64eStatusCycle >= 9;
    if (kind == StatusStream::kWithoutTable && is_table)
      pass[i] = {static_cast<std::uint8_t>('1' + i % drivers::kHdl64eStatusCycle - 9), 0};
  }
  if (kind == StatusStream::kWrongChecksum) pass[packet_of_laser(7, 3)].value ^= 1U;
  std::vector<drivers::Packet> packets;
  packets.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    drivers::Packet packet = turning.packet(i);
    packet.data[1204] = pass[(first + i) % pass.size()].type;
    packet.data[1205] = pass[(first + i) % pass.size()].value;
    packets.push_back(packet);
  }
  return packets;
}

/// Packets of a rotating VLP-16.
inline std::vector<drivers::Packet> vlp16_packets(std::size_t count) {
  TurningSensor turning;
  turning.sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  turning.start_azimuth_deg = 180.0;
  std::vector<drivers::Packet> packets;
  packets.reserve(count);
  for (std::size_t i = 0; i < count; ++i) packets.push_back(turning.packet(i));
  return packets;
}

}  // namespace nilio::tests
