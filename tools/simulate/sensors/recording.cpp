#include "tools/simulate/sensors/recording.hpp"

#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/capture/pcap.hpp"

#include "tools/common/progress.hpp"
#include "tools/common/trajectory.hpp"

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <numbers>
#include <utility>
#include <vector>

#include <tbb/parallel_for.h>

namespace nilio::tools::simulate {

namespace {

using core::Error;
using core::Result;

constexpr std::uint16_t kDataPort = 2368;
constexpr std::uint16_t kPositionPort = 8308;
/// Packets per batch of casting and writing: about 1.3 MB.
constexpr std::uint64_t kBatch = 1024;
constexpr core::Duration kTruthInterval{5'000'000};

Error cannot_write(const std::string& path) {
  const std::string reason = errno != 0 ? std::string(" (") + std::strerror(errno) + ")" : std::string();
  return Error{path + ": cannot be written" + reason +
               "; check the folder's permissions and the space on the disk"};
}

}  // namespace

Result<LidarRecordingSummary> write_lidar_recording(const LidarModel& model, const PositionModel* positions,
                                                    const std::string& path) {
  auto writer = drivers::PcapWriter::create(path);
  if (!writer) return writer.error();
  const auto begin = std::chrono::steady_clock::now();
  Progress progress("casting rays", model.packet_count());
  LidarRecordingSummary summary;
  std::vector<SimulatedPacket> batch;
  for (std::uint64_t first = 0; first < model.packet_count(); first += kBatch) {
    batch.resize(std::min(kBatch, model.packet_count() - first));
    tbb::parallel_for(std::size_t{0}, batch.size(),
                      [&](std::size_t i) { batch[i] = model.make_packet(first + i); });
    for (std::size_t i = 0; i < batch.size(); ++i) {
      errno = 0;
      if (!writer->write(batch[i].stamp, kDataPort, batch[i].payload)) return cannot_write(path);
      summary.returns += batch[i].returns;
      if (positions == nullptr || (first + i) % kDataPacketsPerPosition != 0) continue;
      const SimulatedPosition position = positions->make_packet(summary.position_packets++);
      if (!writer->write(position.stamp, kPositionPort, position.payload)) return cannot_write(path);
    }
    progress.update(first + batch.size());
  }
  errno = 0;
  if (!writer->close()) return cannot_write(path);
  summary.packets = model.packet_count();
  summary.firings = summary.packets * model.layout().firings_per_packet();
  summary.elapsed_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return summary;
}

Result<std::uint64_t> write_imu_recording(const std::function<core::ImuSample()>& next_sample,
                                          std::uint64_t count, ImuFaults faults,
                                          const drivers::ImuPreset& preset, const std::string& path) {
  errno = 0;
  std::ofstream file(path);
  std::uint64_t written = 0;
  for (std::uint64_t i = 0; i < count && file; ++i) {
    const std::optional<core::ImuSample> sample = faults.apply(next_sample());
    if (!sample) continue;
    ++written;
    for (const drivers::CanFrame& frame : drivers::encode_imu_sample(*sample, preset)) {
      if (faults.loses_frame()) continue;
      file << drivers::format_candump_line(frame, "can0") << '\n';
    }
  }
  file.close();
  if (!file) return cannot_write(path);
  return written;
}

Result<std::uint64_t> write_truth(const VehicleTrajectory& trajectory, const core::SE3& T_truth_world,
                                  core::Time start, const std::string& path) {
  tools::Trajectory truth;
  truth.format = TrajectoryFormat::kTum;
  for (core::Duration offset{0}; offset.seconds() <= trajectory.duration_s();
       offset = offset + kTruthInterval) {
    truth.stamps.push_back(start + offset);
    truth.poses.emplace_back((T_truth_world * trajectory.pose(offset.seconds())).matrix());
  }
  const Result<std::size_t> written = write_trajectory(truth, path);
  if (!written) return written.error();
  return std::uint64_t{truth.poses.size()};
}

core::SE3 Mounting::T_base_sensor() const {
  const core::Vector3 rpy = rotation_rpy_deg * (std::numbers::pi / 180.0);
  return {Eigen::AngleAxisd(rpy.z(), core::Vector3::UnitZ()) *
              Eigen::AngleAxisd(rpy.y(), core::Vector3::UnitY()) *
              Eigen::AngleAxisd(rpy.x(), core::Vector3::UnitX()),
          translation_m};
}

Result<bool> write_configuration(const RecordedSensors& sensors, const std::string& path) {
  const auto list = [](const core::Vector3& v) {
    std::array<char, 96> text{};
    std::snprintf(text.data(), text.size(), "[%g, %g, %g]", v.x(), v.y(), v.z());
    return std::string(text.data());
  };
  const auto extrinsic = [&](const Mounting& mounting) {
    return "  extrinsic:\n    translation: " + list(mounting.translation_m) +
           "\n    rotation_rpy_deg: " + list(mounting.rotation_rpy_deg) + "\n";
  };
  errno = 0;
  std::ofstream file(path);
  file << "# Sensors of this simulated recording. base_link is on the ground, x forward.\n"
          "# Extrinsics are poses in base_link: metres; roll, pitch, yaw in degrees, R = Rz(yaw) Ry(pitch) "
          "Rx(roll).\n"
          "lidar:\n  model: "
       << sensors.lidar_model << "\n";
  if (!sensors.calibration_file.empty()) file << "  calibration: " << sensors.calibration_file << "\n";
  file << extrinsic(sensors.lidar);
  if (!sensors.imu_preset.empty())
    file << "imu:\n  preset: " << sensors.imu_preset << "\n" << extrinsic(sensors.imu);
  file.close();
  if (!file) return cannot_write(path);
  return true;
}

}  // namespace nilio::tools::simulate
