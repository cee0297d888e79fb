#pragma once

#include "nilio/core/time.hpp"

#include "ipc/histogram.hpp"
#include "ipc/messages/messages.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>

namespace nilio::tools::watch {

/// Latency from the last packet of a scan to its pose, for a subscriber on the same machine. A pose and the
/// report of its scan are matched by their stamps, in any order of arrival. Not thread-safe.
class PacketToPose {
 public:
  /// `host_id` of this machine (dds::read_host_id()); reports of other machines are counted and left out.
  explicit PacketToPose(std::string host_id) : host_id_(std::move(host_id)) {}

  /// `received_ns` in CLOCK_MONOTONIC.
  void add_pose(core::Time stamp, std::int64_t received_ns);
  void add_report(const dds::ScanReport& report);

  [[nodiscard]] const ipc::Histogram& histogram() const { return *histogram_; }
  [[nodiscard]] std::uint64_t of_other_machines() const { return of_other_machines_; }

 private:
  struct Waiting {
    core::Time stamp;
    std::int64_t ns = 0;
  };
  /// Removes the counterpart of `item` and returns its time. Without one, stores the item in `own` and
  /// returns 0.
  static std::int64_t match(std::deque<Waiting>& others, std::deque<Waiting>& own, const Waiting& item);

  std::string host_id_;
  std::deque<Waiting> poses_;
  std::deque<Waiting> packets_;
  std::uint64_t of_other_machines_ = 0;
  std::unique_ptr<ipc::Histogram> histogram_ = std::make_unique<ipc::Histogram>();
};

}  // namespace nilio::tools::watch
