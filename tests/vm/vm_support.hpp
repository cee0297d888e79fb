#pragma once

#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <sys/types.h>
#include <vector>

/// What the tests inside the guests share. A guest starts processes slowly and runs at the pace that a busy
/// host leaves it, so that everything here waits for conditions and nothing sleeps for a time.
namespace nilio::tests {

/// Limit for whatever has to happen at all; only failing tests take as long.
inline constexpr double kPatienceS = 40.0;

/// Looks again and again. Time in which the host did not let the guest run does not count: its clock goes on
/// without it.
bool eventually(const std::function<bool()>& condition, double seconds = kPatienceS);

/// A line by which the runner takes a run as skipped in which all else has passed.
void say_undecided(const std::string& what);

/// Exit status of a shell command; busybox has ip, insmod, rmmod.
int shell(const std::string& command);

/// A virtual CAN bus that is gone with its object.
class VirtualBus {
 public:
  explicit VirtualBus(std::string name, int mtu = 72);
  VirtualBus(const VirtualBus&) = delete;
  VirtualBus& operator=(const VirtualBus&) = delete;
  ~VirtualBus();
  [[nodiscard]] const std::string& name() const { return name_; }
  /// As unplugging and plugging in: the new one has another number.
  void remove();
  void add();

 private:
  std::string name_;
  int mtu_;
};

/// Administrative state of any interface.
void set_up(const std::string& interface_name, bool up);
bool is_up(const std::string& interface_name);

/// The driver's count of a name in /sys/class/net/*/statistics, such as rx_packets.
std::uint64_t kernel_count(const std::string& interface_name, const std::string& counter);
/// True once the kernel has a CAN socket of any process bound to the interface; frames before that pass by.
bool has_listener(const std::string& interface_name);

drivers::CanFrame data_frame(std::uint32_t id, std::vector<std::uint8_t> data);
/// Puts an error frame in front of the sockets of a virtual bus, as a controller's driver does.
void send_error_frame(const std::string& interface_name, std::uint32_t error_class,
                      std::vector<std::uint8_t> data = std::vector<std::uint8_t>(8));

/// Reads until there are `count` frames.
std::vector<drivers::CanFrame> read_frames(drivers::FrameSource& source, std::size_t count,
                                           double seconds = kPatienceS);
/// Reads until nothing waits; for frames of which is known that they have arrived.
std::vector<drivers::CanFrame> read_waiting(drivers::FrameSource& source);
/// Sends from a process of its own, each frame as soon as the interface takes it.
void send_from_another_process(const std::string& interface_name,
                               const std::vector<drivers::CanFrame>& frames);

/// A program with both output streams in a file; it is killed with its object.
class Program {
 public:
  Program(std::vector<std::string> words, std::filesystem::path log);
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  ~Program();
  [[nodiscard]] std::string output() const;
  /// True once `times` lines of the output have the pattern (ECMAScript).
  [[nodiscard]] bool says(const std::string& pattern, std::size_t times = 1) const;
  /// How many lines have the pattern.
  [[nodiscard]] std::size_t count(const std::string& pattern) const;
  /// Sends the signal and waits for the end; its exit status, or minus the signal that ended it.
  int stop(int signal);
  int wait();

 private:
  std::filesystem::path log_;
  pid_t pid_ = -1;
};

}  // namespace nilio::tests
