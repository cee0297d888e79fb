// Poses of a Velodyne capture: odometry_from_pcap CAPTURE.pcap >trajectory.tum
// The sensor's model is identified from the first packets; without an IMU a constant velocity predicts the
// motion.
#include <cstdio>
#include <nilio/core/odometry.hpp>
#include <nilio/drivers/capture/pcap.hpp>
#include <nilio/drivers/velodyne/decoder.hpp>
#include <nilio/drivers/velodyne/detect.hpp>
#include <vector>

namespace core = nilio::core;
namespace drivers = nilio::drivers;

namespace {

void print(const core::OdometryResult& result) {
  const Eigen::Vector3d& t = result.T_odom_base.translation;
  const Eigen::Quaterniond& q = result.T_odom_base.rotation;
  std::printf("%.9f %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n", result.scan_end.seconds(), t.x(), t.y(), t.z(),
              q.x(), q.y(), q.z(), q.w());
}

/// At most `count` packets from the front of the capture.
std::vector<drivers::Packet> read_packets(drivers::PacketSource& source, std::size_t count) {
  std::vector<drivers::Packet> packets(count);
  std::size_t size = 0;
  while (size < count) {
    const auto read = source.read(std::span(packets).subspan(size), core::Duration::from_milliseconds(10.0));
    if (read.state != drivers::SourceState::kData) break;
    size += read.count;
  }
  packets.resize(size);
  return packets;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return std::fprintf(stderr, "usage: odometry_from_pcap CAPTURE.pcap\n"), 2;
  auto source = drivers::open_pcap(argv[1], {});
  if (!source) return std::fprintf(stderr, "%s\n", source.error().message.c_str()), 1;

  std::vector<drivers::Packet> packets = read_packets(**source, 300);
  const drivers::VelodyneDetection detected = drivers::detect_velodyne(packets);
  if (!detected.model) return std::fprintf(stderr, "unknown sensor: %s\n", detected.evidence.c_str()), 1;

  drivers::ScanAssembler assembler(drivers::make_velodyne_sensor(*detected.model), {});
  core::Odometry odometry(core::OdometryConfig{});
  core::Scan scan;
  for (; !packets.empty(); packets = read_packets(**source, 300)) {
    for (const drivers::Packet& packet : packets) {
      if (!assembler.add(packet)) continue;
      assembler.take_scan(scan);
      print(odometry.register_scan(scan));
    }
  }
}
