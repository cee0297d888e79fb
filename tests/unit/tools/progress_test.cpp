#include "tools/common/progress.hpp"

#include "nilio/core/time.hpp"

#include "tools/common/system.hpp"

#include <array>
#include <cstdio>
#include <fcntl.h>
#include <pty.h>
#include <string>
#include <unistd.h>

#include <catch2/catch.hpp>

using namespace nilio;
using tools::Progress;

namespace {

/// Standard error goes to this descriptor while the object exists.
class ErrorsTo {
 public:
  explicit ErrorsTo(int descriptor) : before_(dup(STDERR_FILENO)) { dup2(descriptor, STDERR_FILENO); }
  ErrorsTo(const ErrorsTo&) = delete;
  ErrorsTo& operator=(const ErrorsTo&) = delete;
  ~ErrorsTo() {
    std::fflush(stderr);
    dup2(before_, STDERR_FILENO);
    close(before_);
  }

 private:
  int before_;
};

/// Half of a job that takes so long.
void work(std::uint64_t total, double seconds) {
  Progress progress("job", total);
  const std::int64_t end = monotonic_ns() + core::Duration::from_seconds(seconds).ns;
  while (monotonic_ns() < end) {
    progress.update(50);
    tools::sleep_for(core::Duration::from_milliseconds(10.0));
  }
}

}  // namespace

TEST_CASE("in a pipe or a log, work shows no progress", "[progress]") {
  std::array<int, 2> pipe{};
  REQUIRE(::pipe2(pipe.data(), O_NONBLOCK) == 0);
  {
    const ErrorsTo errors(pipe[1]);
    work(100, 0.3);
    work(0, 0.3);
  }
  char byte = 0;
  CHECK(read(pipe[0], &byte, 1) == -1);
  close(pipe[0]);
  close(pipe[1]);
}

TEST_CASE("on a terminal, work has a bar, or a count where the total is not known", "[progress]") {
  int terminal = -1;
  int program = -1;
  REQUIRE(openpty(&terminal, &program, nullptr, nullptr, nullptr) == 0);
  {
    const ErrorsTo errors(program);
    work(100, 0.3);
    work(0, 0.3);
  }
  std::array<char, 4096> text{};
  const ssize_t size = read(terminal, text.data(), text.size());
  REQUIRE(size > 0);
  const std::string shown(text.data(), static_cast<std::size_t>(size));
  CHECK(shown.find("job [####################                    ]  50 %") != std::string::npos);
  CHECK(shown.find("\rjob: 50") != std::string::npos);
  close(program);
  close(terminal);
}
