#include "daemon/input/lidar_channel.hpp"

#include "daemon/input/receive.hpp"
#include "daemon/input/scan_feed.hpp"
#include "tests/support/hdl64e_packets.hpp"

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;
using namespace nilio::tests;

namespace {

void receive(ipc::Ring<drivers::Packet>& ring, std::span<const drivers::Packet> packets) {
  for (drivers::Packet packet : packets) {
    packet.received_ns = monotonic_ns();
    REQUIRE(ring.try_push(packet));
  }
}

}  // namespace

TEST_CASE("packets buffered during identification count neither as late nor as backlog, later ones do",
          "[lidar_channel]") {
  const LidarConfig config;
  auto ring = ipc::Ring<drivers::Packet>::in_private_memory(2048);
  ReceiveState state;
  EventLog log;
  LidarChannel channel("lidar", config, {}, std::nullopt, ring, state, log);
  auto data_event = ipc::WakeEvent::create();
  REQUIRE(data_event.ok());
  PacketScanFeed feed(channel, *data_event);
  const std::vector<drivers::Packet> packets = vlp16_packets(1600);
  const std::span<const drivers::Packet> all(packets);

  receive(ring, all.first(800));
  channel.identify();
  REQUIRE(channel.is_identified());
  // The packet that identified the model leaves the others in the ring.
  REQUIRE(channel.packets_in_ring() > 600);
  const std::int64_t known_ns = monotonic_ns();
  core::Scan scan;
  int scans = 0;
  for (; feed.poll(scan) == FeedState::kScan; ++scans) {
    CHECK(feed.waiting_scans() == 0);
    CHECK(scan.received_ns >= known_ns);
  }
  CHECK(scans >= 9);

  receive(ring, all.subspan(800));
  const std::int64_t received_ns = monotonic_ns();
  REQUIRE(feed.poll(scan) == FeedState::kScan);
  CHECK(feed.waiting_scans() >= 8);
  CHECK(scan.received_ns <= received_ns);
}
