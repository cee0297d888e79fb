#include "tools/bench/bench.hpp"
#include "tools/bench/receive/receive_trial.hpp"

#include <cstdio>

namespace nilio::tools::bench {
namespace {

/// Packets per second of a VLS-128 in strongest or last return mode.
constexpr double kSensorRateHz = 6030.0;

void print_row(double rate_hz, const ReceiveTrialResult& r) {
  std::printf("%9.0f %9llu %9llu %8llu %8llu %8llu %7llu %6.1f %% %9.2f %6zu\n", rate_hz,
              static_cast<unsigned long long>(r.sent), static_cast<unsigned long long>(r.received),
              static_cast<unsigned long long>(r.missing), static_cast<unsigned long long>(r.kernel_dropped),
              static_cast<unsigned long long>(r.ring_dropped), static_cast<unsigned long long>(r.stalls),
              100.0 * r.cpu_share, r.mean_batch, r.largest_batch);
}

/// Checks the counters. Returns false with a message on standard error when they do not add up, or when
/// packets were lost without a stall.
bool check(const ReceiveTrialResult& result) {
  if (!result.is_accounted()) {
    std::fprintf(
        stderr, "nilio bench receive: %llu missing and %llu wrong numbers, but %llu dropped as counted\n",
        static_cast<unsigned long long>(result.missing), static_cast<unsigned long long>(result.wrong),
        static_cast<unsigned long long>(result.kernel_dropped) +
            static_cast<unsigned long long>(result.ring_dropped));
    return false;
  }
  if (result.stalls == 0 && result.missing > 0) {
    std::fprintf(stderr,
                 "nilio bench receive: packets were lost without a stall - check the load of the machine and "
                 "the receive buffer (sysctl net.core.rmem_max)\n");
    return false;
  }
  return true;
}

}  // namespace

core::Result<bool> run_receive_bench(const ReceiveOptions& options) {
  std::printf("%9s %9s %9s %8s %8s %8s %7s %8s %9s %6s\n", "packets/s", "sent", "received", "missing",
              "kernel", "ring", "stalls", "CPU", "batch", "max");
  bool good = true;
  for (const double speed : options.speeds) {
    const double rate_hz = speed * kSensorRateHz;
    const auto result = try_receiving({.rate_hz = rate_hz,
                                       .packets = static_cast<std::uint64_t>(rate_hz * options.seconds),
                                       .stall_s = options.stall_ms * 1e-3,
                                       .stall_period_s = options.stall_period_ms * 1e-3,
                                       .receive_buffer_bytes = options.receive_buffer_bytes,
                                       .ring_slots = options.ring_slots});
    if (!result) return result.error();
    print_row(rate_hz, *result);
    good = check(*result) && good;
  }
  return good;
}

}  // namespace nilio::tools::bench
