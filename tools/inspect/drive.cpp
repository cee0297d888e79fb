#include "tools/inspect/drive.hpp"

#include "daemon/config/convert.hpp"
#include "daemon/odometry/pipeline.hpp"
#include "tools/inspect/report/report.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace nilio::tools::inspect {

namespace {

using core::Error;
using core::Result;

constexpr core::Duration kPoll = core::Duration::from_milliseconds(20.0);
/// Margin for samples that the largest correctable offset moves into the drive.
constexpr core::Duration kMargin = core::Duration::from_seconds(2.0 * kLargestCorrectableOffset);

/// All samples of the CAN logs in the odometry's axes and units.
Result<std::vector<core::ImuSample>> read_samples(const daemon::ReplayFiles& files,
                                                  const daemon::Config& config) {
  Result<daemon::Input> input = daemon::open_replay(files, config);
  if (!input) return input.error();
  std::vector<core::ImuSample> samples;
  if (!input->frames) return Error{"imu.enabled is false: there is no IMU to check"};
  const auto frames = std::make_unique<std::array<drivers::CanFrame, 64>>();
  for (;;) {
    const drivers::SourceRead read = input->frames->read(*frames, core::Duration{});
    for (const drivers::CanFrame& frame : std::span(*frames).first(read.count)) {
      if (const auto sample = input->imu_decoder->add(frame)) samples.push_back(*sample);
    }
    if (read.state != drivers::SourceState::kData) break;
  }
  if (!samples.empty()) return samples;
  const std::string name = config.imu.dbc.empty() ? config.imu.preset : config.imu.dbc;
  const std::string& log = files.can_logs.empty() ? files.captures.front() : files.can_logs.front();
  return Error{log + ": no sample of the configured IMU (" + name +
               ") is in it; give a configuration with the IMU's preset, or its dbc and signals (--config)"};
}

/// Ends a recording early, at a stamp, so that the result is reproducible.
class ShortenedSource : public drivers::PacketSource {
 public:
  ShortenedSource(std::unique_ptr<drivers::PacketSource> source, core::Time end)
      : source_(std::move(source)), end_(end) {}

  drivers::SourceRead read(std::span<drivers::Packet> slots, core::Duration timeout) override {
    if (shortened_.load()) return {drivers::SourceState::kEnd, 0};
    drivers::SourceRead result = source_->read(slots, timeout);
    for (std::size_t i = 0; i < result.count; ++i) {
      if (slots[i].stamp < end_) continue;
      shortened_.store(true);
      return {i > 0 ? drivers::SourceState::kData : drivers::SourceState::kEnd, i};
    }
    return result;
  }
  [[nodiscard]] drivers::SourceStats stats() const override { return source_->stats(); }
  [[nodiscard]] std::string status() const override { return source_->status(); }
  [[nodiscard]] bool was_shortened() const { return shortened_.load(); }

 private:
  std::unique_ptr<drivers::PacketSource> source_;
  core::Time end_;
  std::atomic<bool> shortened_{false};
};

/// Shortens all LiDARs; returns the first one's source.
const ShortenedSource* shorten(daemon::Input& input, double seconds) {
  if (!input.packets || !input.first_stamp) return nullptr;
  const core::Time end = *input.first_stamp + core::Duration::from_seconds(seconds);
  auto first = std::make_unique<ShortenedSource>(std::move(input.packets), end);
  const ShortenedSource* const result = first.get();
  input.packets = std::move(first);
  for (daemon::ExtraLidar& lidar : input.more_lidars)
    lidar.packets = std::make_unique<ShortenedSource>(std::move(lidar.packets), end);
  return result;
}

core::SE3 pose_of(const ipc::PoseRecord& record) {
  const auto& q = record.orientation_xyzw;
  return {Eigen::Quaterniond(q[3], q[0], q[1], q[2]), core::Vector3(record.position.data())};
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
  DriveRecorder(daemon::Pipeline& pipeline, const DriveOptions& options, DriveFindings& findings)
      : pipeline_(pipeline), options_(options), findings_(findings) {}

  void drain() {
    while (const auto record = pipeline_.poses().try_pop()) add(*record);
    while (const auto health = pipeline_.imu_health().try_pop()) findings_.health = *health;
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

  daemon::Pipeline& pipeline_;
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
  const ShortenedSource* const source = shorten(*input, options.seconds);
  auto pipeline = daemon::Pipeline::create(config, std::move(input).value(), {}, nullptr);
  if (!pipeline) return pipeline.error();
  DriveFindings findings;
  findings.config = config;
  findings.imu_samples = samples->size();
  DriveRecorder recorder(**pipeline, options, findings);
  if (const auto started = (*pipeline)->start(); !started) return started.error();
  while (!(*pipeline)->finished()) {
    (*pipeline)->output_event().wait(kPoll);
    recorder.drain();
  }
  (*pipeline)->join();
  recorder.drain();
  findings.cut_short = source != nullptr && source->was_shortened();
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
