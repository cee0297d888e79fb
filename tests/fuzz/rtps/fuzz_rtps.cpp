// Sends mutated RTPS datagrams to a participant in a child process and counts its deaths.
//
//   fuzz_rtps DATAGRAMS [SEED [DOMAIN]]
//
// The traffic is recorded at the start, from a real participant that is matched with the child, so that
// identifiers and sequence numbers are those that the child expects. A batch is sent when the child has read
// the previous one. Exit status 1 if the child has died, stopped reading, or a new subscriber gets no pose:
// in another process, whose identifiers are random, every 250,000 datagrams, and at the end also in this one,
// whose identifiers the datagrams may name. The datagrams before a death are in fuzz_rtps-death-N.bin, each
// after its length (4 bytes, little endian). The first two participants of the domain are hit: a program that
// has joined DOMAIN before, such as `nilio watch --domain DOMAIN --interface 127.0.0.1`, is one of them.

#include "ipc/dds/participant.hpp"
#include "tests/fuzz/rtps/mutations.hpp"
#include "tests/fuzz/rtps/participants.hpp"
#include "tests/support/test_domain.hpp"

#include <arpa/inet.h>
#include <array>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fcntl.h>
#include <fstream>
#include <netinet/in.h>
#include <sstream>
#include <stdexcept>
#include <string>
#include <sys/socket.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace nilio::fuzz {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kBatch = 128;
constexpr auto kPatience = std::chrono::seconds(30);
constexpr core::Duration kPosePatience = core::Duration::from_seconds(30.0);

/// UDP ports of the first two participants of the domain: the child's publisher and subscriber
/// (DDSI-RTPS 2.3, section 9.6.1.1).
std::array<std::uint16_t, 4> victim_ports(std::uint32_t domain) {
  const auto base = static_cast<std::uint16_t>(7400 + 250 * domain + 10);
  return {base, static_cast<std::uint16_t>(base + 1), static_cast<std::uint16_t>(base + 2),
          static_cast<std::uint16_t>(base + 3)};
}

/// Bytes that wait in the sockets of these ports, and datagrams dropped there.
struct Queues {
  std::uint64_t bytes = 0;
  std::uint64_t dropped = 0;
};
Queues read_queues(const std::array<std::uint16_t, 4>& ports) {
  Queues queues;
  std::ifstream file("/proc/net/udp");
  std::string line;
  std::getline(file, line);
  while (std::getline(file, line)) {
    unsigned port = 0;
    unsigned waiting = 0;
    if (std::sscanf(line.c_str(), "%*d: %*x:%x %*x:%*x %*x %*x:%x", &port, &waiting) != 2) continue;
    for (const std::uint16_t wanted : ports) {
      if (port != wanted) continue;
      queues.bytes += waiting;
      queues.dropped +=
          std::strtoull(line.c_str() + line.find_last_of(' ', line.find_last_not_of(' ')), nullptr, 10);
    }
  }
  return queues;
}

/// Starts this program again as `role`, "--victim" or "--subscriber".
pid_t start(const char* program, const char* role, std::uint32_t domain, int output) {
  const std::string number = std::to_string(domain);
  const pid_t pid = fork();
  if (pid == 0) {
    dup2(output, STDOUT_FILENO);
    execl("/proc/self/exe", program, role, number.c_str(), nullptr);
    _exit(127);
  }
  return pid;
}

class Victim {
 public:
  Victim(const char* program, std::uint32_t domain) {
    std::array<int, 2> ready{};
    if (pipe2(ready.data(), O_CLOEXEC) != 0) throw std::runtime_error("no pipe");
    pid_ = start(program, "--victim", domain, ready[1]);
    close(ready[1]);
    char byte = 0;
    const bool started = read(ready[0], &byte, 1) == 1;
    close(ready[0]);
    if (!started) throw std::runtime_error("the child does not start");
  }
  ~Victim() { end(); }
  Victim(const Victim&) = delete;
  Victim& operator=(const Victim&) = delete;

  /// Description of its death; empty while it lives.
  std::string death() {
    int status = 0;
    if (pid_ <= 0 || waitpid(pid_, &status, WNOHANG) != pid_) return {};
    pid_ = -1;
    return WIFSIGNALED(status) ? std::string("killed by signal ") + strsignal(WTERMSIG(status))
                               : "ended with status " + std::to_string(WEXITSTATUS(status));
  }
  void end() {
    if (pid_ <= 0) return;
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }
  [[nodiscard]] long resident_mib() const {
    std::ifstream file("/proc/" + std::to_string(pid_) + "/statm");
    long total = 0;
    long resident = 0;
    file >> total >> resident;
    return (resident * sysconf(_SC_PAGESIZE)) >> 20;
  }

 private:
  pid_t pid_ = -1;
};

void save(const std::vector<Datagram>& datagrams, const std::string& path) {
  std::ofstream file(path, std::ios::binary);
  for (const Datagram& datagram : datagrams) {
    const auto size = static_cast<std::uint32_t>(datagram.size());
    for (unsigned shift = 0; shift < 32; shift += 8) file.put(static_cast<char>(size >> shift));
    file.write(reinterpret_cast<const char*>(datagram.data()), static_cast<std::streamsize>(datagram.size()));
  }
}

class Fuzzer {
 public:
  Fuzzer(const char* program, std::uint64_t datagrams, std::uint64_t seed, std::uint32_t domain)
      : program_(program),
        wanted_(datagrams),
        seed_(seed),
        domain_(domain),
        ports_(victim_ports(domain)),
        socket_(socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {}
  ~Fuzzer() { close(socket_); }
  Fuzzer(const Fuzzer&) = delete;
  Fuzzer& operator=(const Fuzzer&) = delete;

  int run() {
    const auto begin = Clock::now();
    while (sent_ < wanted_ && deaths_ < kMaxDeaths && publishes_) attack();
    const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
    std::printf(
        "%llu mutated datagrams of %zu recorded (seed %llu) in %.0f s, %llu not read; %d deaths, %s\n",
        static_cast<unsigned long long>(sent_), recorded_, static_cast<unsigned long long>(seed_), seconds,
        static_cast<unsigned long long>(dropped_), deaths_,
        publishes_ ? "still publishing" : "no longer publishing");
    return deaths_ == 0 && publishes_ ? 0 : 1;
  }

 private:
  static constexpr int kMaxDeaths = 20;
  static constexpr std::uint64_t kProgress = 250'000;

  /// One child, up to its death or the end.
  void attack() {
    Victim victim(program_, domain_);
    RecordingParticipant participant(domain_);
    const auto limit = Clock::now() + kPatience;
    int rounds = 0;
    while (rounds < 20 && Clock::now() < limit) {
      participant.write();
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      if (participant.is_matched()) ++rounds;
    }
    if (rounds == 0) throw std::runtime_error("the child is not found");
    const std::vector<Datagram> recording = participant.recording();
    recorded_ = recording.size();
    Mutator mutator(recording, seed_ + static_cast<std::uint64_t>(deaths_));
    const Queues before = read_queues(ports_);
    std::vector<Datagram> batch;
    while (sent_ < wanted_) {
      std::vector<Datagram> previous = std::exchange(batch, {});
      send_batch(mutator, batch);
      std::string end = wait_until_read(victim);
      if (end.empty()) end = victim.death();
      if (!end.empty()) return report_death(end, previous, batch);
      if (sent_ / kProgress == (sent_ - batch.size()) / kProgress) continue;
      std::fprintf(stderr, "%llu datagrams, child has %ld MiB\n", static_cast<unsigned long long>(sent_),
                   victim.resident_mib());
      publishes_ = is_publishing_to_new_program();
      if (!publishes_) break;
    }
    dropped_ += read_queues(ports_).dropped - before.dropped;
    publishes_ = publishes_ && is_publishing_to_new_program() && is_publishing_to_this_program();
    if (const std::string end = victim.death(); !end.empty()) report_death(end, {}, batch);
  }

  void send_batch(Mutator& mutator, std::vector<Datagram>& batch) {
    for (std::size_t i = 0; i < kBatch; ++i) {
      batch.push_back(mutator.next());
      sockaddr_in to{};
      to.sin_family = AF_INET;
      to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
      // Discovery and data alternately, publisher and subscriber alike.
      to.sin_port = htons(ports_[(sent_ + i) % ports_.size()]);
      sendto(socket_, batch.back().data(), batch.back().size(), 0, reinterpret_cast<const sockaddr*>(&to),
             sizeof to);
    }
    sent_ += kBatch;
  }

  std::string wait_until_read(Victim& victim) {
    const auto limit = Clock::now() + kPatience;
    while (read_queues(ports_).bytes > 0) {
      if (std::string end = victim.death(); !end.empty()) return end;
      if (Clock::now() > limit) {
        victim.end();
        return "stopped reading";
      }
      std::this_thread::sleep_for(std::chrono::microseconds(100));
    }
    return {};
  }

  void report_death(const std::string& end, std::vector<Datagram> previous,
                    const std::vector<Datagram>& batch) {
    const std::string path = "fuzz_rtps-death-" + std::to_string(++deaths_) + ".bin";
    previous.insert(previous.end(), batch.begin(), batch.end());
    save(previous, path);
    std::printf("after %llu datagrams: the child %s; its last datagrams are in %s\n",
                static_cast<unsigned long long>(sent_), end.c_str(), path.c_str());
    std::fflush(stdout);
  }

  [[nodiscard]] bool is_publishing_to_new_program() const {
    int status = 0;
    const pid_t pid = start(program_, "--subscriber", domain_, STDERR_FILENO);
    if (pid > 0 && waitpid(pid, &status, 0) == pid && WIFEXITED(status) && WEXITSTATUS(status) == 0)
      return true;
    std::printf("after %llu datagrams: a new program gets no pose\n", static_cast<unsigned long long>(sent_));
    return false;
  }
  [[nodiscard]] bool is_publishing_to_this_program() const {
    if (receives_pose(domain_, kPosePatience)) return true;
    std::printf("after %llu datagrams: a new participant of this program gets no pose\n",
                static_cast<unsigned long long>(sent_));
    return false;
  }

  const char* program_;
  std::uint64_t wanted_;
  std::uint64_t seed_;
  std::uint32_t domain_;
  std::array<std::uint16_t, 4> ports_;
  int socket_;
  std::uint64_t sent_ = 0;
  std::uint64_t dropped_ = 0;
  std::size_t recorded_ = 0;
  int deaths_ = 0;
  bool publishes_ = true;
};

}  // namespace
}  // namespace nilio::fuzz

int main(int argc, char** argv) {
  if (argc == 3 && std::strcmp(argv[1], "--victim") == 0)
    nilio::fuzz::run_victim(static_cast<std::uint32_t>(std::strtoul(argv[2], nullptr, 10)));
  nilio::dds::set_fastdds_log_handler([](const std::string&) {});
  if (argc == 3 && std::strcmp(argv[1], "--subscriber") == 0) {
    const auto domain = static_cast<std::uint32_t>(std::strtoul(argv[2], nullptr, 10));
    return nilio::fuzz::receives_pose(domain, nilio::fuzz::kPosePatience) ? 0 : 1;
  }
  if (argc < 2 || argc > 4) {
    std::fprintf(stderr, "usage: %s DATAGRAMS [SEED [DOMAIN]]\n", argv[0]);
    return 2;
  }
  const auto number = [&](int index, std::uint64_t otherwise) {
    return argc > index ? std::strtoull(argv[index], nullptr, 10) : otherwise;
  };
  try {
    const auto domain = static_cast<std::uint32_t>(number(3, nilio::tests::test_domain()));
    return nilio::fuzz::Fuzzer(argv[0], number(1, 0), number(2, 1), domain).run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "fuzz_rtps: %s\n", error.what());
    return 2;
  }
}
