#include "tools/bench/receive/receive_trial.hpp"

#include <catch2/catch.hpp>

using nilio::tools::bench::ReceiveTrialResult;
using nilio::tools::bench::try_receiving;

TEST_CASE("packets that fit into the socket's buffer all arrive, however late the reader is",
          "[bench_receive]") {
  const auto trial = try_receiving({.rate_hz = 24120.0, .packets = 60, .stall_s = 0.05});
  REQUIRE(trial.ok());
  // At least one marker packet follows.
  CHECK(trial->sent >= 61);
  CHECK(trial->received == trial->sent);
  CHECK(trial->missing == 0);
  CHECK(trial->kernel_dropped == 0);
  CHECK(trial->ring_dropped == 0);
  CHECK(trial->is_accounted());
}

TEST_CASE("losses of a stalled reader are exactly those that the kernel counts", "[bench_receive]") {
  const auto trial = try_receiving({.rate_hz = 12060.0,
                                    .packets = 9000,
                                    .stall_s = 0.03,
                                    .stall_period_s = 0.1,
                                    .receive_buffer_bytes = 16384});
  REQUIRE(trial.ok());
  CHECK(trial->stalls >= 1);
  CHECK(trial->missing > 0);
  CHECK(trial->received + trial->missing == trial->sent);
  CHECK(trial->missing == trial->kernel_dropped + trial->ring_dropped);
  CHECK(trial->wrong == 0);
  CHECK(trial->largest_batch > 1);
}

TEST_CASE("losses at the very end are counted too", "[bench_receive]") {
  // All packets are sent during the first stall and exceed the buffer.
  const auto trial = try_receiving({.rate_hz = 1e6,
                                    .packets = 500,
                                    .stall_s = 1.0,
                                    .stall_period_s = 100.0,
                                    .receive_buffer_bytes = 4096});
  REQUIRE(trial.ok());
  CHECK(trial->missing > 400);
  CHECK(trial->is_accounted());
}

TEST_CASE("losses of a full ring and of the kernel are counted separately", "[bench_receive]") {
  ReceiveTrialResult total;
  for (int i = 0; i < 5; ++i) {
    const auto trial = try_receiving({.rate_hz = 24120.0, .packets = 3000, .ring_slots = 1});
    REQUIRE(trial.ok());
    CHECK(trial->is_accounted());
    total.ring_dropped += trial->ring_dropped;
  }
  CHECK(total.ring_dropped > 0);
}
