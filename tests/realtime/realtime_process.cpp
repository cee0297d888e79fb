#include "tests/support/eventually.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/room_drive.hpp"
#include "tests/support/udp_support.hpp"

#include <array>
#include <chrono>
#include <csignal>
#include <fcntl.h>
#include <filesystem>
#include <string>
#include <sys/resource.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;

namespace {

namespace fs = std::filesystem;

constexpr uid_t kNobody = 65534;

/// niliod with its output in a pipe that is not read until read() is called.
class PipedNiliod {
 public:
  PipedNiliod(const std::string& program, const std::vector<std::string>& arguments, bool unprivileged) {
    REQUIRE(pipe2(ends_.data(), O_CLOEXEC) == 0);
    REQUIRE(fcntl(ends_[1], F_SETPIPE_SZ, 4096) >= 4096);
    std::vector<std::string> words{program};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = fork();
    if (pid_ == 0) {
      dup2(ends_[1], STDOUT_FILENO);
      dup2(ends_[1], STDERR_FILENO);
      if (unprivileged && !give_up_privileges()) _exit(126);
      execv(argv[0], argv.data());
      _exit(127);
    }
    close(ends_[1]);
  }
  PipedNiliod(const PipedNiliod&) = delete;
  PipedNiliod& operator=(const PipedNiliod&) = delete;
  ~PipedNiliod() { close(ends_[0]); }

  void terminate() const { kill(pid_, SIGTERM); }

  /// Reads small pieces until the output contains this text or ends.
  void read_until(const std::string& wanted) {
    while (text_.find(wanted) == std::string::npos && read_piece()) {
    }
  }
  /// Reads all of the output in small pieces and waits for the end.
  std::string read_slowly() {
    while (read_piece()) {
    }
    int status = 0;
    waitpid(pid_, &status, 0);
    status_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
    return text_;
  }
  [[nodiscard]] int status() const { return status_; }

 private:
  static bool give_up_privileges() {
    const rlimit none{0, 0};
    const rlimit little{64 * 1024, 64 * 1024};
    if (setrlimit(RLIMIT_RTPRIO, &none) != 0 || setrlimit(RLIMIT_MEMLOCK, &little) != 0) return false;
    return geteuid() != 0 || setresuid(kNobody, kNobody, kNobody) == 0;
  }

  bool read_piece() {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    std::array<char, 512> piece{};
    const ssize_t size = read(ends_[0], piece.data(), piece.size());
    if (size > 0) text_.append(piece.data(), static_cast<std::size_t>(size));
    return size > 0;
  }

  std::string text_;
  std::array<int, 2> ends_{-1, -1};
  pid_t pid_ = -1;
  int status_ = -1;
};

/// Copy of niliod that every user may start.
std::string program_for_everybody(const tests::TemporaryFolder& folder) {
  const fs::path copy = folder.path() / "niliod";
  fs::copy_file(nilio::tests::program_folder() + "/niliod", copy);
  for (const fs::path& path : {copy, folder.path()}) {
    fs::permissions(path, fs::perms::owner_all | fs::perms::group_read | fs::perms::group_exec |
                              fs::perms::others_read | fs::perms::others_exec);
  }
  return copy.string();
}

std::vector<std::string> live_arguments() {
  return {"--set", "publisher.enabled=false",
          "--set", "imu.enabled=false",
          "--set", "lidar.port=" + std::to_string(tests::free_port()),
          "--set", "lidar.position_port=0",
          "--set", "lidar.bind_address=127.0.0.1"};
}

}  // namespace

TEST_CASE("without privileges niliod runs and logs the missing grants of each thread and of the memory",
          "[realtime_process][process]") {
  const tests::TemporaryFolder folder;
  PipedNiliod niliod(program_for_everybody(folder), live_arguments(), true);
  // It is processing when it reports missing scans.
  niliod.read_until("no scan for ");
  niliod.terminate();
  const std::string text = niliod.read_slowly();
  INFO(text);
  CHECK(niliod.status() == 0);
  CHECK(text.find("warning: nilio-lidar: FIFO 60 refused") != std::string::npos);
  CHECK(text.find("grant CAP_SYS_NICE or LimitRTPRIO=60; it has normal scheduling on") != std::string::npos);
  CHECK(text.find("warning: nilio-odometry: FIFO 40 refused") != std::string::npos);
  CHECK(text.find("grant CAP_IPC_LOCK or LimitMEMLOCK=infinity") != std::string::npos);
}

TEST_CASE("without privileges a strict niliod exits at once and states the missing grant",
          "[realtime_process][process]") {
  const tests::TemporaryFolder folder;
  std::vector<std::string> arguments = live_arguments();
  arguments.insert(arguments.end(), {"--set", "realtime.strict=true"});
  PipedNiliod niliod(program_for_everybody(folder), arguments, true);
  const std::string text = niliod.read_slowly();
  INFO(text);
  CHECK(niliod.status() == 1);
  CHECK(text.find("niliod: realtime.strict: memory: locking refused") != std::string::npos);
}

TEST_CASE("a reader that starts after the end of the drive gets every line including the last",
          "[realtime_process][process]") {
  const tests::TemporaryFolder folder;
  tests::write_room_drive(folder.path(), tests::s_curve, 1.0, true);
  const fs::path run = folder.path() / "run";
  // Thousands of bytes, more than the pipe's capacity.
  PipedNiliod niliod(nilio::tests::program_folder() + "/niliod",
                     {"--replay", folder.path().string(), "--output", run.string(), "--set",
                      "publisher.enabled=false", "--set", "log.level=debug"},
                     false);
  // All poses are computed although no output was read.
  CHECK(tests::eventually([&] { return fs::exists(run / "latency.json"); }));
  const std::string text = niliod.read_slowly();
  INFO(text);
  CHECK(niliod.status() == 0);
  CHECK(text.find("outputs in " + run.string()) != std::string::npos);
  CHECK(text.find("memory: ") != std::string::npos);
  CHECK(text.find("\nmap ") > text.find("processing time by stage"));
  CHECK(text.find("\nmap ") != std::string::npos);
  CHECK(text.find("lines dropped") == std::string::npos);
}
