#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/bag/point_cloud.hpp"

#include <optional>
#include <span>
#include <string>

namespace nilio::drivers::bag {

/// Raw values of the time field of one cloud, without its stray points.
struct RawTimes {
  double header_s = 0.0;
  double received_s = 0.0;  ///< receive time minus header
  double min = 0.0;
  double max = 0.0;
  bool is_index = false;  ///< the values are the numbers of the points
};

/// Meaning of a time field: time = origin + raw * unit_s.
struct PointTimeForm {
  enum class Origin : std::uint8_t {
    kHeader,    ///< stamp of the header
    kLast,      ///< so that the last point has the stamp of the header
    kMiddle,    ///< so that the middle of the sweep has the stamp of the header
    kFirst,     ///< so that the first point has the stamp of the header
    kAbsolute,  ///< zero: the values are times of a clock
  };
  double unit_s = 1.0;
  Origin origin = Origin::kHeader;
  std::string text;     ///< "ns from the header's stamp, the start of the sweep"
  std::string warning;  ///< empty: none
};

/// Median time between the stamps of the headers, s; empty if it is no sweep's.
std::optional<double> sweep_period(std::span<const RawTimes> clouds);

/// Recognises unit and origin; the units s, ms, us, ns differ by more than the plausible sweeps, so that at
/// most one fits. Empty if the field holds no times (constant). `is_float`: of 32 bits.
core::Result<std::optional<PointTimeForm>> recognise_point_times(std::span<const RawTimes> clouds,
                                                                 bool is_float, PointTimes wanted);

}  // namespace nilio::drivers::bag
