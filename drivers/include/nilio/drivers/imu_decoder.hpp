#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/scan.hpp"
#include "nilio/drivers/dbc.hpp"
#include "nilio/drivers/packet.hpp"

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace nilio::drivers {

/// One axis of the IMU: which DBC signal carries it and how to bring it to SI units and the IMU's x-forward,
/// y-left, z-up axes: value = scale * physical.
struct ImuAxis {
  std::string message;
  std::string signal;
  double scale = 1.0;
};

struct ImuMapping {
  std::string name;
  std::array<ImuAxis, 3> angular_velocity;     ///< to rad/s
  std::array<ImuAxis, 3> linear_acceleration;  ///< to m/s^2, specific force
};

struct ImuDecoderStats {
  std::uint64_t frames = 0;        ///< frames that carry a mapped signal
  std::uint64_t other_frames = 0;  ///< ids that are not mapped
  std::uint64_t short_frames =
      0;  ///< payload shorter than a mapped signal, or a value that is no number: dropped
  std::uint64_t incomplete = 0;  ///< sample groups closed before all signals had arrived
  std::uint64_t samples = 0;
  std::uint64_t out_of_order = 0;  ///< stamps that went back: dropped
};

/// Groups frames into samples: a sample is complete when each mapped signal has arrived once; a signal that
/// arrives twice before that closes the group as incomplete. When the frames of a group come far apart and
/// close to the next group's, the grouping has slipped (a frame was lost): it is put right, and the frames
/// left over count as incomplete. The sample's time is that of its first frame. One thread; no allocation.
class ImuDecoder {
 public:
  /// Fails when a mapped message or signal is not in the database, naming it, the file and the nearest name
  /// there is.
  static core::Result<ImuDecoder> create(const ImuMapping& mapping, const DbcDatabase& database);

  std::optional<core::ImuSample> add(const CanFrame& frame);
  /// The frame's identifier is mapped. Any thread.
  [[nodiscard]] bool takes(const CanFrame& frame) const { return route_of(frame) != nullptr; }
  /// The mapped identifiers as "0x32, 0x1ABCDEF0".
  [[nodiscard]] std::string identifiers() const;
  [[nodiscard]] const ImuDecoderStats& stats() const { return stats_; }

 private:
  struct Axis {
    DbcSignal signal;
    double scale = 1.0;
    /// 0..2 angular velocity, 3..5 linear acceleration.
    std::size_t component = 0;
  };
  struct Route {
    std::uint32_t id = 0;
    bool extended = false;
    std::vector<Axis> axes;
    unsigned mask = 0;
  };

  ImuDecoder() = default;
  [[nodiscard]] const Route* route_of(const CanFrame& frame) const;
  bool begins_after_slip(const CanFrame& frame);
  std::optional<core::ImuSample> complete(core::Time stamp);

  std::vector<Route> routes_;
  ImuDecoderStats stats_;
  std::array<double, 6> values_{};
  unsigned present_ = 0;
  core::Time group_start_;
  /// Of the last complete group.
  core::Time last_start_;
  core::Time last_end_;
  bool has_sample_ = false;
  int slipped_groups_ = 0;
};

/// Built-in IMUs: "xsens_mti", "oxts_rt3003". The DBC texts are those under config/dbc.
struct ImuPreset {
  ImuMapping mapping;
  DbcDatabase database;
};
core::Result<ImuPreset> imu_preset(std::string_view name);
std::vector<std::string> imu_preset_names();

/// The inverse of decoding, for simulation and conversion: the frames (in mapping order, grouped by message)
/// that carry one sample, all stamped with the sample's time.
std::vector<CanFrame> encode_imu_sample(const core::ImuSample& sample, const ImuPreset& preset);

}  // namespace nilio::drivers
