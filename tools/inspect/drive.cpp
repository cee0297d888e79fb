#include "tools/inspect/drive.hpp"

#include "daemon/config/convert.hpp"
#include "tools/inspect/drive_replay.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace nilio::tools::inspect {

namespace {

using core::Error;
using core::Result;

/// Margin for samples that the largest correctable offset moves into the drive.
constexpr core::Duration kMargin = core::Duration::from_seconds(2.0 * kLargestCorrectableOffset);

/// All samples of the CAN logs in the odometry's axes and units.
Result<std::vector<core::ImuSample>> read_samples(const daemon::ReplayFiles& files,
                                                  const daemon::Config& config) {
  Result<daemon::Input> input = daemon::open_replay(files, config);
  if (!input) return input.error();
  std::vector<core::ImuSample> samples;
  if (!input->frames)
    return Error{"there is no IMU on CAN to check: imu.enabled is false, or imu.source is not can"};
  const auto frames = std::make_unique<std::array<drivers::CanFrame, 64>>();
  for (;;) {
    const drivers::SourceRead read = input->frames->read(*frames, core::Duration{});
    for (const drivers::CanFrame& frame : std::span(*frames).first(read.count)) {
      if (const auto sample = input->imu_decoder->add(frame)) samples.push_back(*sample);
    }
    if (read.state != drivers::SourceState::kData) break;
  }
  return samples;
}

core::SE3 pose_of(const ipc::PoseRecord& record) {
  return {core::from_xyzw(record.orientation_xyzw), core::Vector3(record.position.data())};
}

/// Time and pose of the sweep midpoint, which depends little on the motion used for deskewing.
std::pair<core::Time, core::SE3> middle_of(const ipc::PoseRecord& record) {
  const double half_s = 0.5e-9 * static_cast<double>(record.stamp_ns - record.scan_start_ns);
  core::Vector6 twist;
  twist << core::Vector3(record.linear_velocity.data()), core::Vector3(record.deskew_rate.data());
  return {core::Time{record.stamp_ns} - core::Duration::from_seconds(half_s),
          pose_of(record) * core::se3_exp(-half_s * twist)};
}

core::RegisteredMotion motion_between(const ipc::PoseRecord& from, const ipc::PoseRecord& to) {
  const auto [from_time, T_odom_from] = middle_of(from);
  const auto [to_time, T_odom_to] = middle_of(to);
  return {from_time, to_time, T_odom_from, T_odom_to};
}

/// Collects the outputs of the pipeline.
class DriveRecorder {
 public:
  DriveRecorder(const DriveOptions& options, DriveFindings& findings)
      : options_(options), findings_(findings) {}

  void drain(daemon::Pipeline& pipeline) {
    while (const auto record = pipeline.poses().try_pop()) add(*record);
    while (const auto health = pipeline.imu_health().try_pop()) findings_.health = *health;
    if (options_.progress) options_.progress(findings_.seconds);
  }
  [[nodiscard]] const std::vector<core::RegisteredMotion>& motions() const { return motions_; }

 private:
  void add(const ipc::PoseRecord& record) {
    if (!last_) first_ns_ = record.stamp_ns;
    ++findings_.poses;
    findings_.predicted += static_cast<std::uint64_t>(record.predicted);
    findings_.with_gyro += static_cast<std::uint64_t>(record.imu_used);
    findings_.seconds = static_cast<double>(record.stamp_ns - first_ns_) * 1e-9;
    const bool registered = last_ && !last_->predicted && !record.predicted;
    if (registered && record.stamp_ns > last_->stamp_ns) motions_.push_back(motion_between(*last_, record));
    last_ = record;
  }

  const DriveOptions& options_;
  DriveFindings& findings_;
  std::vector<core::RegisteredMotion> motions_;
  std::optional<ipc::PoseRecord> last_;
  std::int64_t first_ns_ = 0;
};

std::span<const core::ImuSample> samples_around(const std::vector<core::ImuSample>& samples,
                                                const std::vector<core::RegisteredMotion>& motions) {
  if (motions.empty()) return {};
  const auto before = [](const core::ImuSample& sample, core::Time time) { return sample.stamp < time; };
  const auto first = std::lower_bound(samples.begin(), samples.end(), motions.front().from - kMargin, before);
  const auto last = std::lower_bound(first, samples.end(), motions.back().to + kMargin, before);
  return {first, last};
}

Result<DriveFindings> drive_once(const daemon::ReplayFiles& files, const daemon::Config& config,
                                 const DriveOptions& options) {
  const Result<std::vector<core::ImuSample>> samples = read_samples(files, config);
  if (!samples) return samples.error();
  Result<daemon::Input> input = daemon::open_replay(files, config);
  if (!input) return input.error();
  DriveFindings findings;
  findings.config = config;
  findings.imu_samples = samples->size();
  DriveRecorder recorder(options, findings);
  const Result<bool> cut_short =
      replay_drive(config, std::move(input).value(),
                   {options.seconds, {}, [&](daemon::Pipeline& pipeline) { recorder.drain(pipeline); }});
  if (!cut_short) return cut_short.error();
  findings.cut_short = *cut_short;
  if (findings.poses == 0) return Error{"no complete scan is in " + files.captures.front()};
  findings.calibration = calibrate_imu(recorder.motions(), samples_around(*samples, recorder.motions()),
                                       {daemon::to_transform(config.imu.extrinsic),
                                        core::Duration::from_milliseconds(config.odometry.max_imu_gap_ms)});
  return findings;
}

}  // namespace

Result<DriveFindings> inspect_drive(const daemon::ReplayFiles& files, const daemon::Config& config,
                                    const DriveOptions& options) {
  Result<DriveFindings> first = drive_once(files, config, options);
  if (!first || !first->calibration.any()) return first;
  const Result<DriveFindings> second = drive_once(files, corrected_config(*first), options);
  if (!second) return second.error();
  first->with_gyro_corrected = second->with_gyro;
  first->calibration = refine(first->calibration, second->calibration);
  return first;
}

}  // namespace nilio::tools::inspect
