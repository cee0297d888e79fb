#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/model.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/convert/kitti_raw.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

namespace nilio::tools::convert {

inline constexpr std::size_t kHdlLasers = 64;
/// The encoder of the HDL-64E S2 counts 4000 steps of 0.09 degrees per revolution.
inline constexpr int kEncoderSteps = 4000;
inline constexpr int kEncoderStepCentidegrees = 9;
/// First step of a KITTI scan. KITTI cuts by the encoder, not by a point's azimuth, so that the lasers' ends
/// differ by their azimuth corrections. With the calibration used here the pattern of steps continues from
/// scan to scan if the cut is at 180.81 degrees.
inline constexpr int kScanCutStep = 2009;

/// The 64 lasers at one azimuth, fired within 48 us. Distance 0 = no return.
struct HdlColumn {
  core::Time stamp;
  std::uint16_t azimuth_centidegrees = 0;
  std::array<drivers::VelodyneDataPacket::Entry, kHdlLasers> returns{};
};

struct EncodedScan {
  /// In order of time.
  std::vector<HdlColumn> columns;
  std::size_t encoded = 0;
  /// Points whose laser has another point in the same column; the later one in the file is left out.
  std::size_t collisions = 0;
  /// Points beyond the range of the packet (131 m).
  std::size_t out_of_range = 0;
};

/// Inverts KITTI's conversion from packets to points: every point is assigned to its laser, encoder step and
/// raw distance, every step to its time, with evenly spaced columns. Reflectance 0..1 becomes 0..255. Fails,
/// with the reason, for clouds that are not unmodified scans of this scanner (motion-compensated, filtered,
/// reordered).
core::Result<EncodedScan> encode_kitti_scan(std::span<const KittiPoint> points, const KittiRawScan& scan,
                                            const drivers::VelodyneSensor& sensor);

/// Ring of every point, 0 = highest: a file contains ring after ring, each counter-clockwise from yaw 0.
std::vector<std::uint16_t> kitti_rings(std::span<const KittiPoint> points);

/// Packs columns into packets of six and writes them to a capture, one continuous stream over all scans.
class HdlPacketStream {
 public:
  HdlPacketStream(drivers::VelodyneSensor sensor, drivers::PcapWriter writer)
      : sensor_(std::move(sensor)), writer_(std::move(writer)) {}

  /// A gap in time (a scan that KITTI lost) ends the packet; its rest has no returns.
  bool add(const HdlColumn& column);
  /// Writes the last packet and closes the file; false on a write error.
  bool finish();
  [[nodiscard]] std::uint64_t packets() const { return packets_; }

 private:
  bool write_packet();
  void set_status_bytes(drivers::VelodyneDataPacket& packet) const;

  drivers::VelodyneSensor sensor_;
  drivers::PcapWriter writer_;
  std::vector<HdlColumn> pending_;
  std::uint64_t packets_ = 0;
};

}  // namespace nilio::tools::convert
