#pragma once

#include <chrono>
#include <thread>

namespace nilio::tests {

/// Waits for what other threads and processes do; false after a time that only a fault takes, however busy
/// the computer is.
template <class Condition>
bool eventually(Condition condition, std::chrono::microseconds pause = std::chrono::milliseconds(5)) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::minutes(5);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > limit) return false;
    std::this_thread::sleep_for(pause);
  }
  return true;
}

}  // namespace nilio::tests
