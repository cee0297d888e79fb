#pragma once

#include <mutex>
#include <string>
#include <thread>

namespace nilio::tests {

/// A serial CAN adapter for the kernel's slcan driver, at the other end of a pseudo-terminal. Keeps the
/// driver's lines; the test sends the adapter's lines, errors included. The destructor removes the interface.
class SlcanAdapter {
 public:
  SlcanAdapter();
  SlcanAdapter(const SlcanAdapter&) = delete;
  SlcanAdapter& operator=(const SlcanAdapter&) = delete;
  ~SlcanAdapter();

  [[nodiscard]] const std::string& interface_name() const { return name_; }
  /// Sends a line of the adapter, without line end: "t1232DEAD" a frame, "e1a" no acknowledgement, "sw057100"
  /// error-warning, "sp130140" error-passive, "sb000256" bus-off, "sa000000" error-active, with the counts
  /// sent and received.
  void say(const std::string& line) const;
  /// All lines of the driver: "S6" 500 kbit/s, "O" open, "C" close, "t..." frames to send.
  [[nodiscard]] std::string received() const;

 private:
  void listen();

  int master_ = -1;
  int slave_ = -1;
  std::string name_;
  mutable std::mutex mutex_;
  std::string heard_;
  std::jthread listener_;
};

}  // namespace nilio::tests
