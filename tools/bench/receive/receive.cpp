#include "tools/bench/receive/receive.hpp"

#include "tools/bench/receive/receive_trial.hpp"

#include <cstdio>
#include <memory>
#include <vector>

#include <CLI/CLI.hpp>

namespace nilio::tools {
namespace {

/// Of a VLS-128 in strongest or last return mode, packets per second.
constexpr double kSensorRateHz = 6030.0;

struct BenchReceiveOptions {
  std::vector<double> speeds{1.0, 4.0};
  double seconds = 5.0;
  double stall_ms = 0.0;
  double stall_period_ms = 1000.0;
  int receive_buffer_bytes = 8 * 1024 * 1024;
  std::size_t ring_slots = 8192;
};

void print_row(double rate_hz, const ReceiveTrialResult& r) {
  std::printf("%9.0f %9llu %9llu %8llu %8llu %8llu %7llu %6.1f %% %9.2f %6zu\n", rate_hz,
              static_cast<unsigned long long>(r.sent), static_cast<unsigned long long>(r.received),
              static_cast<unsigned long long>(r.missing), static_cast<unsigned long long>(r.kernel_dropped),
              static_cast<unsigned long long>(r.ring_dropped), static_cast<unsigned long long>(r.stalls),
              100.0 * r.cpu_share, r.mean_batch, r.largest_batch);
}

/// False with a message on standard error when the figures are not as they have to be.
bool judge(const ReceiveTrialResult& result) {
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
                 "nilio bench receive: packets were lost without a stall; is the machine loaded, or the "
                 "receive buffer small (sysctl net.core.rmem_max)?\n");
    return false;
  }
  return true;
}

bool run(const BenchReceiveOptions& options) {
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
    if (!result) {
      std::fprintf(stderr, "nilio bench receive: %s\n", result.error().message.c_str());
      return false;
    }
    print_row(rate_hz, *result);
    good = judge(*result) && good;
  }
  return good;
}

}  // namespace

void add_bench_receive(CLI::App& bench) {
  const auto options = std::make_shared<BenchReceiveOptions>();
  CLI::App* const command = bench.add_subcommand(
      "receive", "Send numbered packets through loopback at a VLS-128's rate, and account for each");
  command->add_option("--speed", options->speeds, "Multiples of 6,030 packets/s, one trial each")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  command->add_option("--seconds", options->seconds, "Length of a trial")
      ->check(CLI::Range(0.1, 3600.0))
      ->capture_default_str();
  command->add_option("--stall-ms", options->stall_ms, "The receive thread sleeps so long; 0 = never")
      ->check(CLI::Range(0.0, 10000.0))
      ->capture_default_str();
  command->add_option("--stall-period-ms", options->stall_period_ms, "From one stall to the next")
      ->check(CLI::Range(1.0, 60000.0))
      ->capture_default_str();
  command->add_option("--receive-buffer", options->receive_buffer_bytes, "Socket buffer to ask for, bytes")
      ->check(CLI::Range(4096, 1 << 30))
      ->capture_default_str();
  command
      ->add_option("--ring-slots", options->ring_slots, "Packets between the receive thread and its reader")
      ->check(CLI::Range(64, 1 << 20))
      ->capture_default_str();
  command->callback([options] {
    if (!run(*options)) throw CLI::RuntimeError(1);
  });
}

}  // namespace nilio::tools
