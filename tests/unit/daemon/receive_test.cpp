#include "daemon/input/receive.hpp"

#include "nilio/drivers/velodyne/model.hpp"

#include "tests/support/imu_support.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <thread>
#include <vector>

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

/// A bus with the frames of an Xsens at 100 Hz, one frame a read.
class ImuBus final : public drivers::FrameSource {
 public:
  explicit ImuBus(int samples) {
    for (int i = 0; i < samples; ++i) {
      const core::ImuSample sample{core::Time{1'700'000'000'000'000'000 + std::int64_t{i} * 10'000'000},
                                   {0.01 * i, 0.0, 0.0},
                                   {0.0, 0.0, 9.81}};
      const auto more = drivers::encode_imu_sample(sample, tests::preset_of("xsens_mti"));
      frames_.insert(frames_.end(), more.begin(), more.end());
    }
  }
  drivers::SourceRead read(std::span<drivers::CanFrame> slots, core::Duration /*timeout*/) override {
    if (next_ == frames_.size()) return {drivers::SourceState::kEnd, 0};
    slots[0] = frames_[next_++];
    return {drivers::SourceState::kData, 1};
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return {}; }
  [[nodiscard]] std::string status() const override { return {}; }

 private:
  std::vector<drivers::CanFrame> frames_;
  std::size_t next_ = 0;
};

/// Samples that reach the odometry's ring of `slots`, which is emptied after every read.
std::vector<core::ImuSample> receive_samples(int samples, std::size_t slots,
                                             std::optional<drivers::ImuDecoder> decoder) {
  ImuBus bus(samples);
  drivers::ImuIdentification identification(drivers::imu_candidates());
  auto ring = ipc::Ring<core::ImuSample>::in_private_memory(slots);
  auto event = ipc::WakeEvent::create();
  REQUIRE(event.ok());
  ReceivePolicy policy;
  policy.rules = RunRules::Kind::kLive;
  ReceiveState state;
  ImuReceiver receiver(bus, decoder, &identification, ring, *event, policy, state);
  std::vector<core::ImuSample> received;
  bool goes_on = true;
  while (goes_on) {
    goes_on = receiver.run();
    while (const auto sample = ring.try_pop()) received.push_back(*sample);
  }
  receiver.finish();
  CHECK(ring.dropped() == 0);
  return received;
}

}  // namespace

TEST_CASE("an IMU that is identified while it is received gives the samples of a configured one",
          "[receive][imu_detect]") {
  const auto configured = receive_samples(150, 512, tests::decoder_of(tests::preset_of("xsens_mti")));
  REQUIRE(configured.size() >= 149);
  // A ring of 16 is filled several times by what was buffered.
  for (const std::size_t slots : {std::size_t{512}, std::size_t{16}}) {
    const auto identified = receive_samples(150, slots, std::nullopt);
    REQUIRE(identified.size() == configured.size());
    for (std::size_t i = 0; i < identified.size(); ++i) {
      CHECK(identified[i].stamp == configured[i].stamp);
      CHECK(identified[i].angular_velocity == configured[i].angular_velocity);
    }
  }
  // The bus ends with the identification.
  CHECK(receive_samples(102, 16, std::nullopt).size() >= 101);
}

TEST_CASE("packets gather for a millisecond while none can complete a scan, and never afterwards",
          "[receive][timed]") {
  std::atomic<std::int64_t> until_ns{monotonic_ns() + 60'000'000'000};
  CHECK(receive_ms(&until_ns) >= 50.0);
  until_ns = monotonic_ns() - 1;
  CHECK(receive_ms(&until_ns) < 50.0);
  CHECK(receive_ms(nullptr) < 50.0);
  // Sleeps end at that time, too.
  until_ns = monotonic_ns() + 10'000'000;
  receive_ms(&until_ns);
  CHECK(monotonic_ns() >= until_ns);
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
