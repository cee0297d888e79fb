#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/messages.hpp"
#include "ipc/histogram.hpp"

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <string>
#include <utility>

namespace nilio::tools {

/// How long after the last packet of a scan was received its pose was here, for a subscriber on the same
/// machine: the pose and the scan's report are joined by their stamps, whichever comes first. Not
/// thread-safe.
class PacketToPose {
 public:
  /// `host_id`: of this machine (dds::read_host_id()); reports of another are counted and left out.
  explicit PacketToPose(std::string host_id) : host_id_(std::move(host_id)) {}

  /// `received_ns`: CLOCK_MONOTONIC.
  void add_pose(core::Time stamp, std::int64_t received_ns);
  void add_report(const dds::ScanReport& report);

  [[nodiscard]] const ipc::Histogram& histogram() const { return *histogram_; }
  [[nodiscard]] std::uint64_t of_other_machines() const { return of_other_machines_; }

 private:
  struct Waiting {
    core::Time stamp;
    std::int64_t ns = 0;
  };
  /// Takes what waits for the stamp; else `own` waits for its counterpart.
  static std::int64_t match(std::deque<Waiting>& others, std::deque<Waiting>& own, const Waiting& item);

  std::string host_id_;
  std::deque<Waiting> poses_;
  std::deque<Waiting> packets_;
  std::uint64_t of_other_machines_ = 0;
  std::unique_ptr<ipc::Histogram> histogram_ = std::make_unique<ipc::Histogram>();
};

}  // namespace nilio::tools
