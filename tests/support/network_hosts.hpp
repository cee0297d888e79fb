#pragma once

#include <condition_variable>
#include <cstdlib>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <sched.h>
#include <string>
#include <sys/types.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace nilio::tests {

/// A thread in a network namespace of its own: a host as far as the network is concerned. Programs and
/// threads that it starts are on that host, too.
class NetworkHost {
 public:
  NetworkHost() {
    thread_ = std::thread([this] { serve(); });
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return thread_id_ != 0; });
  }
  ~NetworkHost() {
    {
      const std::lock_guard lock(mutex_);
      ending_ = true;
    }
    changed_.notify_all();
    thread_.join();
  }
  NetworkHost(const NetworkHost&) = delete;
  NetworkHost& operator=(const NetworkHost&) = delete;

  /// False without the privilege for a namespace.
  [[nodiscard]] bool isolated() const { return isolated_; }
  [[nodiscard]] pid_t thread_id() const { return thread_id_; }

  /// Runs `work` on the host and waits for its end.
  void run(const std::function<void()>& work) {
    std::unique_lock lock(mutex_);
    work_ = work;
    changed_.notify_all();
    changed_.wait(lock, [this] { return !work_; });
  }
  bool shell(const std::string& command) {
    int status = -1;
    run([&] { status = std::system(command.c_str()); });
    return status == 0;
  }

 private:
  void serve() {
    isolated_ = unshare(CLONE_NEWNET) == 0;
    std::unique_lock lock(mutex_);
    thread_id_ = gettid();
    changed_.notify_all();
    while (true) {
      changed_.wait(lock, [this] { return work_ || ending_; });
      if (!work_) return;
      lock.unlock();
      work_();
      lock.lock();
      work_ = nullptr;
      changed_.notify_all();
    }
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  std::function<void()> work_;
  pid_t thread_id_ = 0;
  bool isolated_ = false;
  bool ending_ = false;
  std::thread thread_;
};

/// Two hosts with a cable between them: 10.77.0.1 and 10.77.0.2, each with its own loopback.
struct TwoHosts {
  NetworkHost first;
  NetworkHost second;

  /// Why they cannot be had here; empty if the cable is in place.
  std::string connect() {
    if (!first.isolated() || !second.isolated()) return "no privilege for network namespaces";
    const std::string other = std::to_string(second.thread_id());
    const bool connected =
        first.shell("ip link add cable0 type veth peer name cable1 netns " + other + " 2>/dev/null") &&
        first.shell("ip addr add 10.77.0.1/24 dev cable0 && ip link set cable0 up && ip link set lo up") &&
        second.shell("ip addr add 10.77.0.2/24 dev cable1 && ip link set cable1 up && ip link set lo up");
    return connected ? "" : "no virtual network cable (iproute2, kernel module veth)";
  }
};

}  // namespace nilio::tests
