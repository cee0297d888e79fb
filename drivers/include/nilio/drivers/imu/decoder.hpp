#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/drivers/can/dbc/dbc.hpp"
#include "nilio/drivers/imu/mapping.hpp"
#include "nilio/drivers/packet.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {

struct ImuDecoderStats {
  std::uint64_t frames = 0;        ///< frames that carry a mapped signal
  std::uint64_t other_frames = 0;  ///< ids that are not mapped
  /// Of the identifiers mapped, but of a J1939 sender other than the one taken.
  std::uint64_t other_sources = 0;
  /// Payload shorter than a mapped signal, or a value that is no number: dropped.
  std::uint64_t short_frames = 0;
  std::uint64_t incomplete = 0;  ///< sample groups closed before all signals had arrived
  std::uint64_t samples = 0;
  std::uint64_t out_of_order = 0;  ///< stamps that went back, or that are no time: dropped
  /// The device's counter says that they were sent, and they did not come out of here whole.
  std::uint64_t lost_samples = 0;
  std::uint64_t bad_status = 0;  ///< the device says that they are bad: dropped
  std::uint64_t invalid = 0;     ///< raw values that say "error" or "not available": dropped
  std::uint64_t repeated = 0;    ///< the device's counter or clock stood: dropped
  /// Beyond the same six values more than 100 times in a row: passed on, since a still, coarse IMU does so,
  /// too.
  std::uint64_t frozen = 0;
  std::uint64_t saturated = 0;  ///< a value at the limit of its bits or of the device: passed on
  /// Intervals of more than one and a half times the usual one.
  std::uint64_t gaps = 0;
  core::Duration longest_gap;
  std::uint64_t device_stamped = 0;  ///< samples that have their time from the device's clock
  std::uint64_t clock_jumps = 0;     ///< of the device's clock or the host's, one against the other
};

/// Tells which frames carry an IMU's signals; a value of its own, for other threads than the decoder's.
class ImuFrameFilter {
 public:
  struct Identifier {
    std::uint32_t id = 0;
    bool extended = false;
    /// From any source address.
    bool j1939 = false;
  };

  explicit ImuFrameFilter(std::vector<Identifier> identifiers) : identifiers_(std::move(identifiers)) {}
  [[nodiscard]] bool takes(const CanFrame& frame) const;
  /// "0x32, 0x1ABCDEF0".
  [[nodiscard]] std::string text() const;

 private:
  std::vector<Identifier> identifiers_;
};

/// Groups frames into samples: a sample is complete when each mapped signal has arrived once; a signal that
/// arrives twice before that closes the group as incomplete, and so does a frame with another counter.
/// Without a counter, when the frames of a group come far apart and close to the next group's, the grouping
/// has slipped (a frame was lost): it is put right, and the frames left over count as incomplete.
///
/// The sample's time is what the device says, fitted onto the times of arrival (offset and drift), or else
/// the stamp of the group's first frame. One thread; nothing is allocated after creation.
class ImuDecoder {
 public:
  /// Fails when a mapped message or signal is not in the database, naming it, the file and the nearest name
  /// there is, and when the device lacks one of the six axes, naming it. Only one of the angular velocities x
  /// and y may be missing: it is taken as 0.
  static core::Result<ImuDecoder> create(const ImuMapping& mapping, const DbcDatabase& database);
  /// For inspection: axes that the device lacks are not numbers (NaN) in the samples. At least one must be
  /// there.
  static core::Result<ImuDecoder> create_partial(const ImuMapping& mapping, const DbcDatabase& database);

  ImuDecoder(ImuDecoder&&) noexcept;
  ImuDecoder& operator=(ImuDecoder&&) noexcept;
  ImuDecoder(const ImuDecoder&) = delete;
  ImuDecoder& operator=(const ImuDecoder&) = delete;
  ~ImuDecoder();

  std::optional<core::ImuSample> add(const CanFrame& frame);
  /// The frames that add() looks at.
  [[nodiscard]] ImuFrameFilter frame_filter() const;
  /// "angular velocity y", or empty.
  [[nodiscard]] const std::string& taken_as_zero() const;
  [[nodiscard]] const ImuDecoderStats& stats() const;
  /// The latest, in degrees Celsius; nothing where the device sends none.
  [[nodiscard]] std::optional<double> temperature_degc() const;

 private:
  struct Impl;
  explicit ImuDecoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The inverse of decoding, for simulation and conversion: the frames (in mapping order, grouped by message)
/// that carry one sample, all stamped with the sample's time. Status, time and counter are set where they are
/// in the same messages as the axes; the counter is `number`, or the stamp in cycles of the message.
std::vector<CanFrame> encode_imu_sample(const core::ImuSample& sample, const ImuPreset& preset,
                                        std::optional<std::uint64_t> number = std::nullopt);

}  // namespace nilio::drivers
