#include "ipc/kernel_requests.hpp"
#include "ipc/publisher_process.hpp"
#include "tests/support/dds_support.hpp"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio::tests;
using nilio::ipc::PoseRecord;
using nilio::ipc::PublisherProcess;
using nilio::ipc::PublisherProcessConfig;
using nilio::ipc::Stage;

/// A busy loop at nice -20 on every core. On its end they are killed.
class BusyLoops {
 public:
  BusyLoops() {
    for (long i = 0; i < sysconf(_SC_NPROCESSORS_ONLN); ++i) {
      const pid_t pid = fork();
      if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        nilio::ipc::leave_fifo();  // of the thread that forks
        setpriority(PRIO_PROCESS, 0, -20);
        for (std::atomic<unsigned> turns{0};; ++turns) {
        }
      }
      pids_.push_back(pid);
    }
  }
  ~BusyLoops() {
    for (const pid_t pid : pids_) {
      kill(pid, SIGKILL);
      waitpid(pid, nullptr, 0);
    }
  }
  BusyLoops(const BusyLoops&) = delete;
  BusyLoops& operator=(const BusyLoops&) = delete;

 private:
  std::vector<pid_t> pids_;
};

bool may_use_fifo() {
  bool granted = false;
  std::thread([&] { granted = nilio::ipc::request_fifo(50).empty(); }).join();
  return granted;
}

constexpr std::int64_t kMs = 1'000'000;
constexpr int kWarmUp = 100;
constexpr int kPoses = 1000;
constexpr auto kPeriod = std::chrono::milliseconds(10);

}  // namespace

TEST_CASE("with a busy loop at nice -20 on every core a FIFO reader gets 99 % of the poses within 5 ms",
          "[load][timed]") {
  const auto publisher = built_program("nilio-publisher");
  const auto cyclone = built_program("nilio-cyclone-reader");
  if (!publisher || !cyclone) return;
  if (!may_use_fifo()) {
    WARN("skipped: no privilege for FIFO scheduling");
    return;
  }
  const std::uint32_t domain = test_domain();
  Program reader(kCycloneLoopback + std::string("chrt -f 50 ") + cyclone->string() + " " +
                 std::to_string(domain) + " " + std::to_string(kWarmUp + kPoses) + " 60 arrivals");
  PublisherProcessConfig config = process_config(*publisher, domain);
  config.wait_for_subscribers = kPatience;
  config.lock_memory = true;
  config.priority = 30;
  auto process = PublisherProcess::create(config);
  REQUIRE(process.ok());
  REQUIRE((*process)->start().ok());

  std::map<std::int64_t, std::int64_t> delivered;  // of a stamp
  std::uint64_t late_before = 0;                   // the first poses wait for the reader
  std::thread producer([&] {
    nilio::ipc::request_fifo(40);
    auto next = std::chrono::steady_clock::now();
    std::unique_ptr<BusyLoops> load;
    for (int i = 0; i < kWarmUp + kPoses; ++i) {
      if (i == kWarmUp) {
        late_before = (*process)->state().late_poses();
        load = std::make_unique<BusyLoops>();
      }
      PoseRecord record = sample_record(static_cast<std::uint64_t>(i));
      record.state = nilio::core::TrackingState::kTracking;
      record.has_deadline = true;
      record.overshoot_ns = -5 * kMs;
      const std::int64_t now = monotonic_ns();
      record.stage_ns[static_cast<std::size_t>(Stage::kReceived)] = now;
      record.stage_ns[static_cast<std::size_t>(Stage::kDelivered)] = now;
      delivered[record.stamp_ns] = now;
      (*process)->publish(record);
      next += kPeriod;
      std::this_thread::sleep_until(next);
    }
  });
  std::vector<std::pair<std::int64_t, std::int64_t>> arrivals;  // stamp, time
  while (const auto line = reader.line()) {
    std::istringstream in(*line);
    std::string kind;
    std::int64_t at = 0;
    in >> kind >> at;
    if (kind == "arrival") arrivals.emplace_back(read_stamp(in).ns, at);
  }
  producer.join();
  REQUIRE(arrivals.size() >= kWarmUp + kPoses);
  std::vector<double> latencies_ms;
  for (std::size_t i = kWarmUp; i < arrivals.size(); ++i)
    latencies_ms.push_back(static_cast<double>(arrivals[i].second - delivered.at(arrivals[i].first)) / kMs);
  std::sort(latencies_ms.begin(), latencies_ms.end());
  const auto percentile = [&](double share) {
    return latencies_ms[static_cast<std::size_t>(share * static_cast<double>(latencies_ms.size() - 1))];
  };
  const std::uint64_t late = (*process)->state().late_poses() - late_before;
  WARN("delivery to a CycloneDDS reader: p50 "
       << percentile(0.5) << ", p99 " << percentile(0.99) << ", p99.9 " << percentile(0.999) << ", max "
       << percentile(1.0) << " ms; " << late << " poses written more than 5 ms late");
  CHECK(percentile(0.99) <= 5.0);
  CHECK((*process)->state().poses() == kWarmUp + kPoses);
  CHECK(late <= kPoses / 100);
}
