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

/// 0..2 angular velocity, 3..5 linear acceleration.
const ImuAxis& imu_axis(const ImuMapping& mapping, std::size_t component);
std::string imu_component_name(std::size_t component);

/// What one frame says.
struct ImuFrameContent {
  /// Bits of the components in `values`.
  unsigned present = 0;
  std::array<double, kImuComponents> values{};
  bool saturated = false;
  bool invalid = false;
  bool bad_status = false;
  std::optional<std::uint64_t> counter;
  std::optional<std::uint64_t> ticks;
  std::optional<double> temperature;
};

/// The mapped signals of one message. Signals are counted in its database's order.
struct ImuRoute {
  struct Axis {
    std::size_t signal = 0;
    double scale = 1.0;
    std::size_t component = 0;
    /// SI; infinite when the device has no stated range.
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
  /// A bit above the components' for messages that belong to each sample without carrying an axis.
  unsigned member = 0;

  /// Nothing when the payload is too short for a signal that it should hold, or a value is not a number.
  [[nodiscard]] std::optional<ImuFrameContent> read(const CanFrame& frame) const;
};

/// All of a mapping's messages. Fails naming what is not in the database or cannot serve. `member` bits are
/// given in the order of the mapping.
core::Result<std::vector<ImuRoute>> make_imu_routes(const ImuMapping& mapping, const DbcDatabase& database);

/// SAE J1939-21: the group of a 29-bit identifier, without priority, source and, where it is addressed,
/// destination.
std::uint32_t j1939_group(std::uint32_t id);

}  // namespace nilio::drivers
