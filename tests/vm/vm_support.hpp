#pragma once

#include "nilio/drivers/packet.hpp"
#include "nilio/drivers/source.hpp"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <sys/types.h>
#include <vector>

/// Helpers of the tests inside the guests. A guest starts processes slowly and runs at the pace of a busy
/// host, hence all helpers wait for conditions instead of fixed times.
namespace nilio::tests {

/// Time limit of every condition; only failing tests take as long.
inline constexpr double kPatienceS = 40.0;

/// Checks a condition repeatedly. Time in which the host did not run the guest does not count, although the
/// guest's clock advances.
bool eventually(const std::function<bool()>& condition, double seconds = kPatienceS);

/// Prints the line that makes the runner report an otherwise passed run as skipped.
void say_undecided(const std::string& what);

/// Number of lines in which the pattern is found.
[[nodiscard]] std::size_t count_lines(const std::string& text, const std::string& pattern);

/// Exit status of a shell command; busybox has ip, insmod, rmmod.
int shell(const std::string& command);

/// A virtual CAN bus, removed by the destructor.
class VirtualBus {
 public:
  explicit VirtualBus(std::string name, int mtu = 72);
  VirtualBus(const VirtualBus&) = delete;
  VirtualBus& operator=(const VirtualBus&) = delete;
  ~VirtualBus();
  [[nodiscard]] const std::string& name() const { return name_; }
  /// Replaces the bus, as unplugging and plugging in does: the new one has another number.
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
/// True once any process has a CAN socket bound to the interface; earlier frames are lost.
bool has_listener(const std::string& interface_name);

drivers::CanFrame data_frame(std::uint32_t id, std::vector<std::uint8_t> data);
/// Delivers an error frame to the sockets of a virtual bus, as a controller's driver does.
void send_error_frame(const std::string& interface_name, std::uint32_t error_class,
                      std::vector<std::uint8_t> data = std::vector<std::uint8_t>(8));

/// Reads until `count` frames have arrived.
std::vector<drivers::CanFrame> read_frames(drivers::FrameSource& source, std::size_t count,
                                           double seconds = kPatienceS);
/// Reads all waiting frames; for frames that are known to have arrived.
std::vector<drivers::CanFrame> read_waiting(drivers::FrameSource& source);
/// Sends from a separate process, each frame as soon as the interface accepts it.
void send_from_another_process(const std::string& interface_name,
                               const std::vector<drivers::CanFrame>& frames);

/// A program with both output streams in a file; the destructor kills it.
class Program {
 public:
  Program(std::vector<std::string> words, std::filesystem::path log);
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;
  ~Program();
  [[nodiscard]] std::string output() const;
  /// True once `times` lines of the output match the pattern (ECMAScript).
  [[nodiscard]] bool has_line(const std::string& pattern, std::size_t times = 1) const;
  /// Number of lines that match the pattern.
  [[nodiscard]] std::size_t count(const std::string& pattern) const;
  /// Sends the signal and waits for the end; returns the exit status, or minus the signal that ended it.
  int stop(int signal);
  int wait();

 private:
  std::filesystem::path log_;
  pid_t pid_ = -1;
};

}  // namespace nilio::tests
