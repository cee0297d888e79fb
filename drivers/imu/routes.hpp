#pragma once

#include "nilio/core/result.hpp"
#include "nilio/drivers/imu/mapping.hpp"
#include "nilio/drivers/packet.hpp"

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace nilio::drivers {

inline constexpr std::size_t kImuComponents = 6;
inline constexpr unsigned kAllImuComponents = (1U << kImuComponents) - 1U;

/// Axis of a component: 0..2 angular velocity, 3..5 linear acceleration.
const ImuAxis& imu_axis(const ImuMapping& mapping, std::size_t component);
std::string imu_component_name(std::size_t component);

/// Decoded content of one frame.
struct ImuFrameContent {
  /// Bits of the components present in `values`.
  unsigned present = 0;
  std::array<double, kImuComponents> values{};
  bool saturated = false;
  bool invalid = false;
  bool bad_status = false;
  std::optional<std::uint64_t> counter;
  std::optional<std::uint64_t> ticks;
  std::optional<double> temperature;
};

/// Mapped signals of one message, as indices into its signals.
struct ImuRoute {
  struct Axis {
    std::size_t signal = 0;
    double scale = 1.0;
    std::size_t component = 0;
    /// Measurement range, SI; infinite when none is stated.
    double range = 0.0;
    std::optional<std::uint64_t> invalid_from;
  };
  struct Status {
    std::size_t signal = 0;
    std::uint64_t mask = 0;
    std::uint64_t good = 0;
    bool is_range = false;
  };

  DbcMessage message;
  std::vector<Axis> axes;
  std::vector<Status> status;
  std::optional<std::size_t> counter;
  std::optional<std::size_t> ticks;
  std::optional<std::size_t> temperature;
  /// Bit above the components' for messages without an axis that belong to each sample.
  unsigned member = 0;

  /// Decodes a frame. Empty when the payload is too short for one of its signals, or a value is not a
  /// number.
  [[nodiscard]] std::optional<ImuFrameContent> read(const CanFrame& frame) const;
};

/// Routes of all messages of a mapping. The error names a missing or unusable message or signal. `member`
/// bits are assigned in the order of the mapping.
core::Result<std::vector<ImuRoute>> make_imu_routes(const ImuMapping& mapping, const DbcDatabase& database);

/// Parameter group of a 29-bit identifier (SAE J1939-21), without priority, source and, for addressed groups,
/// destination.
std::uint32_t j1939_group(std::uint32_t id);

}  // namespace nilio::drivers
