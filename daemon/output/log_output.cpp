#include "daemon/output/log_output.hpp"

#include "daemon/log_format.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <ctime>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <string_view>
#include <unistd.h>
#include <utility>

#include <spdlog/async_logger.h>
#include <spdlog/details/null_mutex.h>
#include <spdlog/details/thread_pool.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

namespace nilio::daemon {

namespace {

constexpr int kPollMs = 100;
// At the end of the program, a reader that takes no data for this time is given up.
constexpr int kPatienceMs = 300;
// A pipe that is writable at all has room for this.
constexpr std::size_t kPieceBytes = 4096;

// For the handler of fatal signals, which cannot access the logger.
std::atomic<std::uint64_t> pieces_written{0};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

void wait_ms(long milliseconds) {
  const timespec pause{milliseconds / 1000, milliseconds % 1000 * 1'000'000};
  nanosleep(&pause, nullptr);
}

void begin_thread() {
  pthread_setname_np(pthread_self(), "nilio-log");
  // Independent of the scheduling niliod was started with.
  const sched_param normal{};
  pthread_setschedparam(pthread_self(), SCHED_OTHER, &normal);
  // Signals belong to the main thread.
  sigset_t all;
  sigfillset(&all);
  for (const int fault : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) sigdelset(&all, fault);
  pthread_sigmask(SIG_BLOCK, &all, nullptr);
}

extern "C" void die_with_log(int signal) {
  constexpr int kQuietMs = 50;
  constexpr int kLongestMs = 1000;
  constexpr int kStepMs = 10;
  std::uint64_t before = pieces_written.load();
  for (int waited = 0, quiet = 0; waited < kLongestMs && quiet < kQuietMs; waited += kStepMs) {
    wait_ms(kStepMs);
    quiet = pieces_written.load() == before ? quiet + kStepMs : 0;
    before = pieces_written.load();
  }
  std::array<char, 40> line{"niliod: ended by signal 00\n"};
  constexpr std::size_t kDigits = 24;
  line[kDigits] = static_cast<char>('0' + signal / 10 % 10);
  line[kDigits + 1] = static_cast<char>('0' + signal % 10);
  if (write(STDERR_FILENO, line.data(), kDigits + 3) < 0) _exit(128 + signal);
  // SA_RESETHAND has removed the handler: this ends the process with the signal.
  raise(signal);
}

}  // namespace

class LogOutput::Sink final : public spdlog::sinks::base_sink<spdlog::details::null_mutex> {
 public:
  explicit Sink(int file_descriptor) : file_descriptor_(file_descriptor) {}

  /// Call before the first line.
  void watch(spdlog::details::thread_pool& pool) { pool_ = &pool; }
  /// From now on, do not wait for a reader that takes no data.
  void hurry() { hurries_.store(true); }

 protected:
  void sink_it_(const spdlog::details::log_msg& message) override {
    report_drops();
    spdlog::memory_buf_t text;
    formatter_->format(message, text);
    write_all({text.data(), text.size()});
  }
  void flush_() override {}

 private:
  void report_drops() {
    const std::size_t lost = pool_->overrun_counter();
    if (lost == reported_drops_) return;
    std::array<char, 120> line{};
    const int length = std::snprintf(
        line.data(), line.size(), "niliod warning: %zu lines dropped: this output is not read fast enough\n",
        lost - std::exchange(reported_drops_, lost));
    write_all({line.data(), static_cast<std::size_t>(length)});
  }

  void write_all(std::string_view text) {
    int waited_ms = 0;
    while (!text.empty()) {
      pollfd output{file_descriptor_, POLLOUT, 0};
      const int ready = poll(&output, 1, gave_up_ ? 0 : kPollMs);
      if (ready == 0 || (ready < 0 && errno == EINTR)) {
        waited_ms = hurries_.load() ? waited_ms + kPollMs : 0;
        if (waited_ms >= kPatienceMs || gave_up_) break;
        continue;
      }
      const ssize_t written = write(file_descriptor_, text.data(), std::min(text.size(), kPieceBytes));
      if (written < 0 && (errno == EINTR || errno == EAGAIN)) continue;
      if (written < 0) return;
      pieces_written.fetch_add(1);
      text.remove_prefix(static_cast<std::size_t>(written));
      waited_ms = 0;
    }
    gave_up_ = !text.empty();
  }

  int file_descriptor_;
  spdlog::details::thread_pool* pool_ = nullptr;
  std::size_t reported_drops_ = 0;
  bool gave_up_ = false;
  std::atomic<bool> hurries_{false};
};

struct LogOutput::State {
  std::shared_ptr<Sink> sink;
  std::shared_ptr<spdlog::details::thread_pool> pool;
  std::shared_ptr<spdlog::logger> logger_before;
};

LogOutput::LogOutput(const LogOutputConfig& config) : state_(std::make_unique<State>()) {
  state_->sink = std::make_shared<Sink>(config.file_descriptor);
  state_->pool = std::make_shared<spdlog::details::thread_pool>(config.queue_lines, 1, begin_thread);
  state_->sink->watch(*state_->pool);
  auto logger = std::make_shared<spdlog::async_logger>("niliod", state_->sink, state_->pool,
                                                       spdlog::async_overflow_policy::overrun_oldest);
  logger->set_formatter(log_formatter("niliod", config.file_descriptor));
  logger->set_level(spdlog::level::from_str(config.level));
  state_->logger_before = spdlog::default_logger();
  spdlog::set_default_logger(std::move(logger));
}

LogOutput::~LogOutput() {
  spdlog::set_default_logger(state_->logger_before);
  state_->sink->hurry();
  // Writes the queued lines, then ends the thread.
  state_->pool.reset();
}

std::uint64_t LogOutput::lines_lost() const { return state_->pool->overrun_counter(); }

void write_log_before_dying() {
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT}) {
    struct sigaction action {};
    if (sigaction(signal, nullptr, &action) != 0 || action.sa_handler != SIG_DFL) continue;
    action.sa_handler = die_with_log;
    action.sa_flags = static_cast<int>(SA_RESETHAND | SA_NODEFER);
    sigaction(signal, &action, nullptr);
  }
}

}  // namespace nilio::daemon
