#include "daemon/output/log_output.hpp"

#include <array>
#include <chrono>
#include <cstdlib>
#include <fcntl.h>
#include <memory>
#include <regex>
#include <string>
#include <sys/stat.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <spdlog/spdlog.h>

using nilio::daemon::LogOutput;
using nilio::daemon::LogOutputConfig;

namespace {

class Pipe {
 public:
  Pipe() {
    REQUIRE(pipe2(ends_.data(), O_CLOEXEC) == 0);
    // Minimum pipe size, which fills quickly.
    REQUIRE(fcntl(ends_[1], F_SETPIPE_SZ, 4096) >= 4096);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  ~Pipe() {
    close_input();
    close(ends_[0]);
  }
  void close_input() {
    if (ends_[1] >= 0) close(ends_[1]);
    ends_[1] = -1;
  }
  [[nodiscard]] int input() const { return ends_[1]; }

  /// Reads to the end in small pieces.
  std::string read_slowly() {
    std::string text;
    std::array<char, 256> piece{};
    for (ssize_t size = 1; size > 0;) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      size = read(ends_[0], piece.data(), piece.size());
      if (size > 0) text.append(piece.data(), static_cast<std::size_t>(size));
    }
    return text;
  }

 private:
  std::array<int, 2> ends_{-1, -1};
};

std::size_t count(const std::string& text, const std::string& pattern) {
  const std::regex expression(pattern);
  return static_cast<std::size_t>(
      std::distance(std::sregex_iterator(text.begin(), text.end(), expression), std::sregex_iterator()));
}

/// Sum over all reports: a few lines may be written between two drops.
std::uint64_t lines_said_lost(const std::string& text) {
  const std::regex expression("niliod warning: ([0-9]+) lines dropped");
  std::uint64_t sum = 0;
  for (auto match = std::sregex_iterator(text.begin(), text.end(), expression);
       match != std::sregex_iterator(); ++match)
    sum += std::stoull((*match)[1]);
  return sum;
}

}  // namespace

TEST_CASE("logging does not wait for a slow reader, and no line is lost while the queue has room",
          "[log_output]") {
  Pipe pipe;
  auto log = std::make_unique<LogOutput>(LogOutputConfig{pipe.input(), "info", 1000});
  // Ten times the pipe's capacity; a blocking logger would never return, because the pipe is not read yet.
  for (int i = 0; i < 800; ++i) spdlog::info("line {} of a log that nobody reads", i);
  std::string text;
  std::thread reader([&] { text = pipe.read_slowly(); });
  CHECK(log->lines_lost() == 0);
  log.reset();
  pipe.close_input();
  reader.join();
  CHECK(count(text, "niliod info: line [0-9]+ of") == 800);
  CHECK(text.ends_with("line 799 of a log that nobody reads\n"));
}

TEST_CASE("a full queue drops the oldest lines, reports their number and keeps the last line",
          "[log_output]") {
  Pipe pipe;
  auto log = std::make_unique<LogOutput>(LogOutputConfig{pipe.input(), "info", 50});
  for (int i = 0; i < 1000; ++i) spdlog::info("line {} of a log that nobody reads", i);
  const std::uint64_t lost = log->lines_lost();
  CHECK(lost > 700);
  std::string text;
  std::thread reader([&] { text = pipe.read_slowly(); });
  log.reset();
  pipe.close_input();
  reader.join();
  CHECK(count(text, "niliod info: line [0-9]+ of") == 1000 - lost);
  CHECK(lines_said_lost(text) == lost);
  CHECK(text.ends_with("line 999 of a log that nobody reads\n"));
}

TEST_CASE("a reader that never reads does not prevent the program from ending", "[log_output]") {
  Pipe pipe;
  auto log = std::make_unique<LogOutput>(LogOutputConfig{pipe.input(), "info", 1000});
  for (int i = 0; i < 800; ++i) spdlog::info("line {} of a log that nobody reads", i);
  log.reset();
  SUCCEED("it ended");
}

TEST_CASE("lines logged before a fault are written, followed by the fatal signal", "[log_output]") {
  Pipe pipe;
  const pid_t child = fork();
  if (child == 0) {
    dup2(pipe.input(), STDOUT_FILENO);
    dup2(pipe.input(), STDERR_FILENO);
    // Remove Catch's own signal handlers.
    signal(SIGSEGV, SIG_DFL);
    const LogOutput log(LogOutputConfig{STDOUT_FILENO, "info", 1000});
    nilio::daemon::write_log_before_dying();
    for (int i = 0; i < 300; ++i) spdlog::info("line {} before the fault", i);
    raise(SIGSEGV);
    _exit(0);
  }
  pipe.close_input();
  const std::string text = pipe.read_slowly();
  int status = 0;
  REQUIRE(waitpid(child, &status, 0) == child);
  CHECK(WIFSIGNALED(status));
  CHECK(text.find("line 299 before the fault\n") != std::string::npos);
  CHECK(text.ends_with("niliod: ended by signal 11\n"));
}

TEST_CASE("in the journal, lines have its priority instead of a time", "[log_output]") {
  Pipe pipe;
  // Room for all lines: nobody reads until they are written.
  REQUIRE(fcntl(pipe.input(), F_SETPIPE_SZ, 65536) >= 65536);
  struct stat status {};
  REQUIRE(fstat(pipe.input(), &status) == 0);
  const std::string stream = std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino);
  const bool is_journal = GENERATE(true, false);
  // A program with another output keeps the variable of the journal.
  setenv("JOURNAL_STREAM", is_journal ? stream.c_str() : "1:2", 1);
  {
    const LogOutput log({pipe.input()});
    spdlog::info("is well");
    spdlog::warn("is hot");
    spdlog::error("burns");
  }
  unsetenv("JOURNAL_STREAM");
  pipe.close_input();
  const std::string text = pipe.read_slowly();
  if (is_journal) {
    CHECK(text == "<6>is well\n<4>is hot\n<3>burns\n");
  } else {
    const std::string time = "[0-9-]{10} [0-9:.]{12} niliod ";
    CHECK(std::regex_match(
        text, std::regex(time + "info: is well\n" + time + "warning: is hot\n" + time + "error: burns\n")));
  }
}
