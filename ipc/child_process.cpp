#include "ipc/child_process.hpp"

#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <sched.h>
#include <spawn.h>
#include <unistd.h>
#include <utility>

namespace nilio::ipc {
namespace {

// Copy of a descriptor above the numbers that the child's descriptors will use.
class DescriptorCopy {
 public:
  explicit DescriptorCopy(int original) : copy_(fcntl(original, F_DUPFD_CLOEXEC, 16)) {}
  DescriptorCopy(DescriptorCopy&& other) noexcept : copy_(std::exchange(other.copy_, -1)) {}
  ~DescriptorCopy() {
    if (copy_ >= 0) close(copy_);
  }
  DescriptorCopy(const DescriptorCopy&) = delete;
  DescriptorCopy& operator=(const DescriptorCopy&) = delete;
  DescriptorCopy& operator=(DescriptorCopy&&) = delete;
  [[nodiscard]] int get() const { return copy_; }

 private:
  int copy_;
};

void set_attributes(posix_spawnattr_t& attributes) {
  sigset_t blocked;
  sigemptyset(&blocked);
  sigaddset(&blocked, SIGTERM);
  sigaddset(&blocked, SIGINT);
  sigset_t defaults;
  sigfillset(&defaults);
  const sched_param normal{};
  posix_spawnattr_setsigmask(&attributes, &blocked);
  posix_spawnattr_setsigdefault(&attributes, &defaults);
  posix_spawnattr_setpgroup(&attributes, 0);
  posix_spawnattr_setschedpolicy(&attributes, SCHED_OTHER);
  posix_spawnattr_setschedparam(&attributes, &normal);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF |
                                            POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSCHEDULER);
}

int spawn_with_descriptors(char* const* argv, const std::vector<DescriptorCopy>& descriptors, pid_t& pid) {
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  int next = kFirstInheritedDescriptor;
  for (const DescriptorCopy& descriptor : descriptors)
    posix_spawn_file_actions_adddup2(&actions, descriptor.get(), next++);
  posix_spawn_file_actions_addclosefrom_np(&actions, next);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  set_attributes(attributes);
  const int failure = posix_spawn(&pid, *argv, &actions, &attributes, argv, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&actions);
  return failure;
}

}  // namespace

core::Result<pid_t> spawn_child(std::vector<std::string> arguments, const std::vector<int>& descriptors) {
  std::vector<DescriptorCopy> copies;
  for (const int descriptor : descriptors) copies.emplace_back(descriptor);
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);
  pid_t pid = -1;
  const int failure = spawn_with_descriptors(argv.data(), copies, pid);
  if (failure != 0) return core::Error{arguments.front() + ": " + std::strerror(failure)};
  return pid;
}

}  // namespace nilio::ipc
