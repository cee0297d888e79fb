#include "tools/view/view.hpp"

#include "nilio/core/clock.hpp"

#include "daemon/exit_status.hpp"
#include "tools/common/files.hpp"
#include "tools/common/progress.hpp"
#include "tools/view/http_request.hpp"
#include "tools/view/live_content.hpp"
#include "tools/view/run_content.hpp"

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <malloc.h>
#include <memory>
#include <spawn.h>
#include <sys/signalfd.h>
#include <unistd.h>
#include <utility>

extern char** environ;  // NOLINT(readability-redundant-declaration): unistd.h has it only with _GNU_SOURCE

namespace nilio::tools::view {

namespace {

constexpr int kInterrupted = 130;
constexpr std::size_t kMinToken = 16;

int fail(const std::string& message) {
  std::cerr << "nilio view: " << message << '\n';
  return kFailed;
}

/// SIGINT and SIGTERM as a descriptor, blocked in the threads of DDS, too.
class Signals {
 public:
  Signals() {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    sigprocmask(SIG_BLOCK, &signals, nullptr);
    std::signal(SIGPIPE, SIG_IGN);
    descriptor_ = signalfd(-1, &signals, SFD_CLOEXEC | SFD_NONBLOCK);
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  ~Signals() { ::close(descriptor_); }

  bool arrived() {
    signalfd_siginfo signal{};
    if (::read(descriptor_, &signal, sizeof signal) == sizeof signal)
      signal_ = static_cast<int>(signal.ssi_signo);
    return signal_ != 0;
  }
  [[nodiscard]] int exit_status() const { return signal_ == SIGINT ? kInterrupted : static_cast<int>(kDone); }

 private:
  int descriptor_ = -1;
  int signal_ = 0;
};

core::Result<std::string> read_token(const std::string& path) {
  auto text = file_text(path);
  if (!text) return core::Error{path + ": cannot be read - give a file that holds the token"};
  while (!text->empty() && (text->back() == '\n' || text->back() == '\r' || text->back() == ' '))
    text->pop_back();
  const bool is_plain = std::ranges::all_of(*text, [](char c) { return c > 0x20 && c < 0x7F; });
  if (text->size() < kMinToken || text->size() > 200 || !is_plain)
    return core::Error{path + ": a token has 16 to 200 letters and digits on one line"};
  return *text;
}

void open_in_browser(const std::string& url) {
  const bool has_display = std::getenv("DISPLAY") != nullptr || std::getenv("WAYLAND_DISPLAY") != nullptr;
  if (::isatty(STDOUT_FILENO) != 1 || !has_display) return;
  std::string program = "xdg-open";
  std::string argument = url;
  std::array<char*, 3> arguments{program.data(), argument.data(), nullptr};
  pid_t child = 0;
  // Without xdg-open the address is printed all the same.
  ::posix_spawnp(&child, program.c_str(), nullptr, nullptr, arguments.data(), environ);
}

int serve(const Options& options, Server::Options server_options, Content& content, LiveContent* live,
          Signals& signals) {
  if (!options.token_file.empty()) {
    auto token = read_token(options.token_file);
    if (!token) return fail(token.error().message);
    server_options.token = std::move(token).value();
  } else if (!is_loopback(server_options.address)) {
    server_options.token = random_token();
  }
  auto server = Server::create(server_options, content);
  if (!server) return fail(server.error().message);
  if (live != nullptr) live->set_server(**server);
  std::string host = server_options.address;
  if (host.find(':') != std::string::npos) host = "[" + host + "]";
  std::string url = "http://" + host + ":" + std::to_string((*server)->port());
  if (!server_options.token.empty()) url += "/#token=" + server_options.token;
  if (compressed_page()->empty()) std::cerr << "nilio view: warning: " << page_missing_message() << '\n';
  std::cout << "nilio view: " << url
            << (options.runs.empty() ? "  (live; Ctrl-C ends it)" : "  (Ctrl-C ends it)") << std::endl;
  if (options.open_browser) open_in_browser(url);
  (*server)->run([&signals] { return signals.arrived(); });
  return signals.exit_status();
}

int view_runs(const Options& options, Signals& signals) {
  const auto blocks = run_blocks(options.runs, options.truths, {});
  if (!blocks) return fail(blocks.error().message);
  RunContent content(*blocks);
  return serve(options, options.server, content, nullptr, signals);
}

int view_live(const Options& options, Signals& signals) {
  // Clouds and tiles return to the system when they are freed: left alone, the limit rises with their size.
  ::mallopt(M_MMAP_THRESHOLD, 256 << 10);
  auto subscriber = dds::OdometrySubscriber::create(options.subscriber);
  if (!subscriber) return fail(subscriber.error().message);
  LiveContent content(std::move(subscriber).value(), options.subscriber);
  return serve(options, options.server, content, &content, signals);
}

}  // namespace

int run(const Options& options) {
  Signals signals;
  if (!options.runs.empty()) return view_runs(options, signals);
  if (!options.truths.empty()) return fail("--truth: only for finished runs - name a RUN folder");
  return view_live(options, signals);
}

}  // namespace nilio::tools::view
