#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/core/time.hpp"
#include "nilio/drivers/bag/messages.hpp"

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// Origin of the times of the points of a cloud.
enum class PointTimes : std::uint8_t {
  kAuto,     ///< recognised from the data
  kStart,    ///< times count from the stamp of the header
  kEnd,      ///< the stamp of the header is the time of the last point
  kMiddle,   ///< the stamp of the header is the middle of the sweep
  kAzimuth,  ///< the time field is ignored: times by azimuth
  kNone,     ///< no times: the points are motion-compensated already, or need not be
};
/// "auto", "start", "end", "middle", "azimuth", "none"; the order is that of the values.
std::span<const char* const> point_times_names();
std::optional<PointTimes> parse_point_times(std::string_view name);

/// A cloud that owns its bytes.
struct CloudCopy {
  explicit CloudCopy(const CloudView& cloud);
  CloudCopy(CloudCopy&&) noexcept = default;
  CloudCopy& operator=(CloudCopy&&) noexcept = default;
  CloudCopy(const CloudCopy&) = delete;
  CloudCopy& operator=(const CloudCopy&) = delete;
  ~CloudCopy() = default;

  CloudView view;
  std::vector<std::uint8_t> bytes;
};

/// Turns point clouds of any spinning or solid-state LiDAR into scans: finds the columns of position, time,
/// ring and intensity by name, and unit and origin of the times, rank and spacing of the beams from the data.
/// The rules: docs/recordings.md. One thread.
class CloudDecoder {
 public:
  /// Number of clouds that create() needs; fewer at the end of a short recording.
  static constexpr std::size_t kSamples = 12;

  /// Determines the layout from the first clouds of a recording. Fails without x, y and z, and for times of which no unit
  /// gives a sweep of 20 to 300 ms; the error names the values. `name` names the topic in messages.
  static core::Result<CloudDecoder> create(std::span<const CloudCopy> clouds, const std::string& name,
                                           PointTimes times = PointTimes::kAuto);
  CloudDecoder(CloudDecoder&&) noexcept;
  CloudDecoder& operator=(CloudDecoder&&) noexcept;
  ~CloudDecoder();

  /// Fills points, start, end, coverage and beam spacing. False if no point is left: points that are not
  /// finite or at the origin are no returns.
  bool decode(const CloudView& cloud, core::Scan& scan);
  /// Lines for the user: the layout and how it was recognised; and doubts about it.
  [[nodiscard]] const std::vector<std::string>& notes() const;
  [[nodiscard]] const std::vector<std::string>& warnings() const;
  /// Points dropped because their time is outside of the sweep.
  [[nodiscard]] std::uint64_t stray_points() const;

 private:
  struct Impl;
  explicit CloudDecoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace nilio::drivers
