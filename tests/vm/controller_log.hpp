#pragma once

#include "nilio/drivers/can/can_controller.hpp"

#include "tests/vm/vm_support.hpp"

#include <algorithm>
#include <memory>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// A controller's watcher and its log lines.
class ControllerLog {
 public:
  explicit ControllerLog(const drivers::CanControllerConfig& config) {
    auto controller = drivers::CanController::watch(config);
    REQUIRE(controller.ok());
    controller_ = std::move(controller).value();
  }

  /// True once `times` lines have the pattern.
  bool has_line(const std::string& pattern, std::size_t times = 1) {
    const std::regex expression(pattern);
    const bool found = eventually([&] {
      const auto lines = events();
      return std::count_if(lines.begin(), lines.end(), [&](const std::string& line) {
               return std::regex_search(line, expression);
             }) >= static_cast<std::ptrdiff_t>(times);
    });
    if (!found) {
      for (const std::string& line : lines_) UNSCOPED_INFO(line);
    }
    return found;
  }
  const std::vector<std::string>& events() {
    for (const drivers::CanEvent& event : controller_->take_events()) lines_.push_back(event.message);
    return lines_;
  }
  [[nodiscard]] drivers::CanControllerStatus status() const { return controller_->status(); }

 private:
  std::unique_ptr<drivers::CanController> controller_;
  std::vector<std::string> lines_;
};

}  // namespace nilio::tests
