#pragma once

#include <mutex>
#include <string>
#include <thread>

namespace nilio::tests {

/// An adapter on a serial line as the kernel's slcan driver sees it, at the other end of a pseudo-terminal:
/// what the driver says is kept, and what the adapter says, errors included, is up to the test. The interface
/// is gone with its object.
class SlcanAdapter {
 public:
  SlcanAdapter();
  SlcanAdapter(const SlcanAdapter&) = delete;
  SlcanAdapter& operator=(const SlcanAdapter&) = delete;
  ~SlcanAdapter();

  [[nodiscard]] const std::string& interface_name() const { return name_; }
  /// A line of the adapter, without its end: "t1232DEAD" a frame, "e1a" no acknowledgement, "sw057100"
  /// error-warning, "sp130140" error-passive, "sb000256" bus-off, "sa000000" error-active, with the counts
  /// sent and received.
  void say(const std::string& line) const;
  /// All that the driver has said: "S6" 500 kbit/s, "O" open, "C" close, "t..." frames to send.
  [[nodiscard]] std::string heard() const;

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
