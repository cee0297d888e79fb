#include "tools/common/child_process.hpp"

#include "tools/common/system.hpp"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <string_view>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>
#include <utility>

namespace nilio::tools {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

/// Environment of this program with `more` replacing variables of the same name, null-terminated.
std::vector<char*> environment_with(std::vector<std::string>& more) {
  const auto is_replaced = [&more](const std::string_view variable) {
    const std::string_view name = variable.substr(0, variable.find('=') + 1);
    return std::any_of(more.begin(), more.end(),
                       [name](const std::string& other) { return other.starts_with(name); });
  };
  std::vector<char*> result;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    if (!is_replaced(*variable)) result.push_back(*variable);
  }
  for (std::string& variable : more) result.push_back(variable.data());
  result.push_back(nullptr);
  return result;
}

/// In the child: signal handling as after a shell, independent of this process.
void restore_signals() {
  for (const int signal : {SIGPIPE, SIGXFSZ, SIGINT, SIGTERM, SIGHUP}) ::signal(signal, SIG_DFL);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
}

[[noreturn]] void become(const char* program, char* const* arguments, char* const* environment, int log,
                         pid_t parent) {
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() != parent) _exit(126);
  // Own process group: this program forwards a Ctrl-C itself.
  setpgid(0, 0);
  restore_signals();
  if (dup2(log, STDOUT_FILENO) < 0 || dup2(log, STDERR_FILENO) < 0) _exit(126);
  execve(program, arguments, environment);
  _exit(127);
}

}  // namespace

Result<ChildProcess> ChildProcess::start(const fs::path& program, const std::vector<std::string>& arguments,
                                         const fs::path& log, std::vector<std::string> more_environment) {
  if (access(program.c_str(), X_OK) != 0)
    return Error{program.string() + ": could not be started (" + std::strerror(errno) + ")"};
  const int descriptor = open(log.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (descriptor < 0) return Error{log.string() + ": cannot be written (" + std::strerror(errno) + ")"};
  std::vector<std::string> words{program.string()};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  argv.reserve(words.size() + 1);
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  std::vector<char*> envp = environment_with(more_environment);
  const pid_t parent = getpid();
  // Signals are blocked until the child has reset this program's handlers.
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  const pid_t pid = fork();
  if (pid == 0) become(program.c_str(), argv.data(), envp.data(), descriptor, parent);
  const int reason = errno;
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  close(descriptor);
  if (pid < 0) return Error{program.string() + ": could not be started (" + std::strerror(reason) + ")"};
  return ChildProcess(pid, log);
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)), log_(std::move(other.log_)), ended_(other.ended_) {}

ChildProcess& ChildProcess::operator=(ChildProcess&& other) noexcept {
  if (this == &other) return *this;
  kill_and_reap();
  pid_ = std::exchange(other.pid_, -1);
  log_ = std::move(other.log_);
  ended_ = other.ended_;
  return *this;
}

ChildProcess::~ChildProcess() { kill_and_reap(); }

void ChildProcess::kill_and_reap() {
  if (pid_ <= 0 || ended_) return;
  kill(pid_, SIGKILL);
  waitpid(pid_, nullptr, 0);
}

std::optional<int> ChildProcess::poll() {
  if (ended_ || pid_ <= 0) return ended_;
  int status = 0;
  if (waitpid(pid_, &status, WNOHANG) == pid_)
    ended_ = WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  return ended_;
}

void ChildProcess::send_signal(int signal) const {
  if (pid_ > 0 && !ended_) kill(pid_, signal);
}

int ChildProcess::stop(core::Duration patience) {
  send_signal(SIGTERM);
  const std::int64_t deadline = monotonic_ns() + patience.ns;
  while (!poll() && monotonic_ns() < deadline) sleep_for(kPoll);
  if (!ended_) {
    kill_and_reap();
    ended_ = -SIGKILL;
  }
  return *ended_;
}

std::string ChildProcess::last_line() const {
  std::ifstream file(log_);
  std::string last;
  for (std::string line; std::getline(file, line);) {
    if (!line.empty()) last = line;
  }
  return last.empty() ? "no output" : last;
}

Result<fs::path> find_sibling_program(const std::string& name) {
  std::error_code error;
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  fs::path program = self.parent_path() / name;
  if (!error && access(program.c_str(), X_OK) == 0) return program;
  return Error{program.string() + ": not found or not executable - build or install " + name + " beside " +
               self.filename().string()};
}

}  // namespace nilio::tools
