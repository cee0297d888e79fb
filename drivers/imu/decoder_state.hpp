#pragma once

#include "nilio/drivers/imu/decoder.hpp"

#include "drivers/imu/routes.hpp"
#include "drivers/imu/sample_clock.hpp"
#include "drivers/imu/sample_monitor.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {

/// Frames of one sample, as far as they have arrived.
struct ImuGroup {
  /// Components, and above them messages that belong to each sample.
  unsigned members = 0;
  std::array<double, kImuComponents> values{};
  /// Of the first frame with an axis.
  core::Time first_stamp;
  std::optional<std::uint64_t> counter;
  std::optional<std::uint64_t> ticks;
  core::Time ticks_stamp;
  bool saturated = false;
  bool invalid = false;
  bool bad_status = false;

  [[nodiscard]] unsigned components() const { return members & kAllImuComponents; }
};

struct ImuDecoder::State {
  State(const ImuMapping& mapping, std::vector<ImuRoute> routes);

  std::optional<core::ImuSample> add(const CanFrame& frame);

  /// Axes that no frame carries: 0 from now on instead of no number.
  void take_as_zero(const std::string& axes);

  std::vector<ImuRoute> routes;
  std::string taken_as_zero;
  ImuDecoderStats stats;
  core::Duration time_offset;
  std::optional<double> temperature;

 private:
  struct SampleStamp {
    core::Time time;
    bool is_from_device = false;
  };
  const ImuRoute* find_route(const CanFrame& frame);
  bool is_from_source(const CanFrame& frame);
  [[nodiscard]] bool contradicts_group(const ImuFrameContent& content, unsigned members) const;
  void close_incomplete();
  void join_group(const ImuFrameContent& content, unsigned members, core::Time stamp);
  bool begins_after_slip(core::Time stamp);
  std::optional<core::ImuSample> complete(core::Time stamp);
  bool follows_counter(const ImuGroup& group);
  SampleStamp stamp_of(const ImuGroup& group, core::Time last_frame);
  bool is_dropped(const ImuGroup& group);

  unsigned wanted_ = 0;
  std::optional<std::uint8_t> source_;
  bool source_is_given_ = false;
  core::Time source_seen_;
  std::uint64_t counter_mask_ = 0;
  std::optional<ImuSampleClock> clock_;
  ImuSampleMonitor monitor_;
  ImuGroup group_;
  std::optional<std::uint64_t> last_counter_;
  std::optional<std::uint64_t> last_ticks_;
  // Of the last complete group, by the stamps of its frames with axes.
  core::Time last_start_;
  core::Time last_end_;
  UsualInterval usual_interval_;
  bool has_group_ = false;
  core::Time last_stamp_;
  bool has_sample_ = false;
  int slipped_groups_ = 0;
};

}  // namespace nilio::drivers
