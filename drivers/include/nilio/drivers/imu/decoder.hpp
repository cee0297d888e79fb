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
  /// Frames with mapped identifiers of another J1939 sender than the accepted one.
  std::uint64_t other_sources = 0;
  /// Payload shorter than a mapped signal, or a value that is not a number: dropped.
  std::uint64_t short_frames = 0;
  std::uint64_t incomplete = 0;  ///< sample groups closed before all signals had arrived
  std::uint64_t samples = 0;
  std::uint64_t out_of_order = 0;  ///< stamps that went back or are invalid: dropped
  /// Samples that the device sent, by its counter, and that did not arrive complete.
  std::uint64_t lost_samples = 0;
  std::uint64_t bad_status = 0;  ///< status signal not good: dropped
  std::uint64_t invalid = 0;     ///< raw values that mean "error" or "not available": dropped
  std::uint64_t repeated = 0;    ///< device counter or clock did not advance: dropped
  /// Samples with the same six values, from the 101st in a row on: passed on, because a coarse IMU at rest
  /// does the same.
  std::uint64_t frozen = 0;
  std::uint64_t saturated = 0;  ///< a value at the limit of its bits or of the device: passed on
  /// Intervals longer than 1.5 times the median.
  std::uint64_t gaps = 0;
  core::Duration longest_gap;
  std::uint64_t device_stamped = 0;  ///< samples stamped by the device's clock
  std::uint64_t clock_jumps = 0;     ///< jumps of the device's clock against the host's
};

/// Recognises the frames that carry an IMU's signals. Independent of the decoder, hence usable in other
/// threads.
class ImuFrameFilter {
 public:
  struct Identifier {
    std::uint32_t id = 0;
    bool extended = false;
    /// Match frames of any source address.
    bool j1939 = false;
  };

  explicit ImuFrameFilter(std::vector<Identifier> identifiers) : identifiers_(std::move(identifiers)) {}
  /// Also recognises the frames of another filter.
  void merge(const ImuFrameFilter& other) {
    identifiers_.insert(identifiers_.end(), other.identifiers_.begin(), other.identifiers_.end());
  }
  [[nodiscard]] bool takes(const CanFrame& frame) const;
  /// "0x32, 0x1ABCDEF0".
  [[nodiscard]] std::string text() const;

 private:
  std::vector<Identifier> identifiers_;
};

/// Groups frames into samples: a sample is complete when each mapped signal has arrived once. A signal that
/// arrives twice before that, or a frame with another counter, closes the group as incomplete. Without a
/// counter, frames that are far from their own group and close to the next show that a frame was lost: the
/// grouping is shifted, and the frames left over count as incomplete.
///
/// The sample's time is the device's time fitted onto the times of arrival (offset and drift), or else the
/// stamp of the group's first frame. One thread; nothing is allocated after creation.
class ImuDecoder {
 public:
  /// Fails when a mapped message or signal is not in the database (the error names it, the file and the
  /// nearest name), and when the device lacks one of the six axes. Only one of the angular velocities x and y
  /// may be missing: it is taken as 0.
  static core::Result<ImuDecoder> create(const ImuMapping& mapping, const DbcDatabase& database);
  /// For inspection: axes that the device lacks are NaN in the samples. At least one axis must exist.
  static core::Result<ImuDecoder> create_partial(const ImuMapping& mapping, const DbcDatabase& database);

  ImuDecoder(ImuDecoder&&) noexcept;
  ImuDecoder& operator=(ImuDecoder&&) noexcept;
  ImuDecoder(const ImuDecoder&) = delete;
  ImuDecoder& operator=(const ImuDecoder&) = delete;
  ~ImuDecoder();

  /// Processes one frame; returns the sample that it completes, if any.
  std::optional<core::ImuSample> add(const CanFrame& frame);
  /// Filter for the frames that add() uses.
  [[nodiscard]] ImuFrameFilter frame_filter() const;
  /// Axis without a signal, "angular velocity y", or empty.
  [[nodiscard]] const std::string& taken_as_zero() const;
  [[nodiscard]] const ImuDecoderStats& stats() const;
  /// Latest temperature, degrees Celsius; nothing where the device sends none.
  [[nodiscard]] std::optional<double> temperature_degc() const;

 private:
  struct Impl;
  explicit ImuDecoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

/// The inverse of decoding, for simulation and conversion: the frames of one sample, in mapping order,
/// grouped by message and stamped with the sample's time. Status, time and counter are set where they share a
/// message with an axis; the counter is `number`, or the stamp in cycles of the message.
std::vector<CanFrame> encode_imu_sample(const core::ImuSample& sample, const ImuPreset& preset,
                                        std::optional<std::uint64_t> number = std::nullopt);

}  // namespace nilio::drivers
