#include "daemon/input/receive.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include <atomic>
#include <chrono>
#include <thread>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::daemon;

namespace {

/// A socket at which a packet waits whenever it is read; counts the reads.
class BusySource final : public drivers::PacketSource {
 public:
  explicit BusySource(std::uint64_t packets) : packets_(packets) {}

  drivers::SourceRead read(std::span<drivers::Packet> slots, core::Duration /*timeout*/) override {
    if (stats_.delivered == packets_) return {drivers::SourceState::kEnd, 0};
    ++stats_.delivered;
    slots[0].size = drivers::kDataPacketSize;
    return {drivers::SourceState::kData, 1};
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return stats_; }
  [[nodiscard]] std::string status() const override { return {}; }

 private:
  std::uint64_t packets_;
  drivers::SourceStats stats_;
};

void receive_all(drivers::PacketSource& source, ipc::Ring<drivers::Packet>& ring, ipc::WakeEvent& event,
                 const ReceivePolicy& policy, ReceiveState& state) {
  PacketReceiver receiver(source, ring, event, policy, state);
  while (receiver.run()) {
  }
  receiver.finish();
}

/// Time to receive 50 packets that are there already.
double receive_ms(const std::atomic<std::int64_t>* gather_until_ns) {
  BusySource source(50);
  auto ring = ipc::Ring<drivers::Packet>::in_private_memory(64);
  auto event = ipc::WakeEvent::create();
  REQUIRE(event.ok());
  ReceivePolicy policy;
  policy.gather_until_ns = gather_until_ns;
  ReceiveState state;
  const std::int64_t start_ns = monotonic_ns();
  receive_all(source, ring, *event, policy, state);
  CHECK(ring.size() == 50);
  return static_cast<double>(monotonic_ns() - start_ns) * 1e-6;
}

}  // namespace

TEST_CASE("packets gather for a millisecond while none can complete a scan, and never afterwards",
          "[receive]") {
  std::atomic<std::int64_t> until_ns{monotonic_ns() + 60'000'000'000};
  CHECK(receive_ms(&until_ns) >= 50.0);
  until_ns = monotonic_ns() - 1;
  CHECK(receive_ms(&until_ns) < 50.0);
  CHECK(receive_ms(nullptr) < 50.0);
  // Sleeps end at that time, too.
  until_ns = monotonic_ns() + 10'000'000;
  const double until_there_ms = receive_ms(&until_ns);
  CHECK(until_there_ms >= 10.0);
}

TEST_CASE("packets that a full ring drops are counted as dropped here", "[receive]") {
  BusySource source(100);
  auto ring = ipc::Ring<drivers::Packet>::in_private_memory(64);
  auto event = ipc::WakeEvent::create();
  REQUIRE(event.ok());
  ReceiveState state;
  ReceivePolicy policy;
  policy.rules = RunRules::Kind::kLive;
  receive_all(source, ring, *event, policy, state);
  CHECK(ring.dropped() == 36);
  CHECK(state.data_dropped.load() == 36);
}
