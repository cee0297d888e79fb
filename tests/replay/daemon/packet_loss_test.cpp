#include "nilio/drivers/capture/pcap.hpp"

#include "tests/support/disturbed_packets.hpp"
#include "tests/support/replay_run.hpp"
#include "tests/support/room_drive.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tests;

namespace {

/// Copies a capture and its CAN log, if there is one, without a random share of the data packets.
void lose_packets(const std::filesystem::path& from, const std::filesystem::path& to, double share) {
  auto source = drivers::open_pcap((from / "lidar.pcap").string(), {});
  REQUIRE(source.ok());
  std::vector<drivers::Packet> recorded;
  std::vector<drivers::Packet> slots(64);
  for (auto read = (*source)->read(slots, {}); read.state == drivers::SourceState::kData;
       read = (*source)->read(slots, {}))
    recorded.insert(recorded.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  auto writer = drivers::PcapWriter::create((to / "lidar.pcap").string());
  REQUIRE(writer.ok());
  for (const drivers::Packet& packet : disturb(recorded, {"", share}, 19))
    REQUIRE(writer->write(packet.stamp, packet.destination_port, std::span(packet.data).first(packet.size)));
  REQUIRE(writer->close());
  if (std::filesystem::exists(from / "imu.log")) std::filesystem::copy_file(from / "imu.log", to / "imu.log");
}

/// Standard deviation of the position of the tracking poses, as median, m.
double median_deviation(const ReplayRun& run) {
  std::vector<double> deviations;
  for (const ipc::PoseRecord& pose : run.poses) {
    const auto& c = pose.pose_covariance;
    if (pose.state == ipc::TrackingState::kTracking) deviations.push_back(std::sqrt(c[0] + c[7] + c[14]));
  }
  REQUIRE(deviations.size() > 20);
  std::ranges::sort(deviations);
  return deviations[deviations.size() / 2];
}

}  // namespace

TEST_CASE("with evenly lost packets every scan has a pose, and its position is not more certain",
          "[packet_loss]") {
  const bool has_imu = GENERATE(false, true);
  const TemporaryFolder whole;
  write_room_drive(whole.path(), s_curve, 4.0, has_imu);
  const ReplayRun reference = run_replay(whole.text());
  for (const double share : {0.2, 0.5}) {
    const TemporaryFolder folder;
    lose_packets(whole.path(), folder.path(), share);
    const ReplayRun run = run_replay(folder.text());
    CAPTURE(has_imu, share);
    CHECK(run.poses.size() == reference.poses.size());
    // The error that all points of a scan share limits it, not their number.
    CHECK(median_deviation(run) > 0.95 * median_deviation(reference));
  }
}
