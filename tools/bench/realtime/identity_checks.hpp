#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/odometry/table.hpp"
#include "tools/bench/realtime/realtime_run.hpp"
#include "tools/common/stop_signals.hpp"

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools {

/// Two runs that have to give the same poses, to the bit.
struct IdentityCheck {
  enum class Verdict : std::uint8_t {
    kPass,
    kFail,
    kNotComparable,  ///< the runs did not get the same input; `remark` says why
  };
  std::string name;
  Verdict verdict = Verdict::kFail;
  /// SHA-256 of trajectory.kitti, or of as many of its lines as both have.
  std::string first;
  std::string second;
  std::string remark;
};

/// SHA-256 of the first `lines` lines of a text; of all of it when there are fewer.
std::string sha256_of_lines(const std::string& text, std::size_t lines);

/// Poses of a live run against those of the file: a stream that stops does not tell that its last scan is
/// complete, so the file may have one pose more. Fails the check when there are none.
IdentityCheck compare_with_file(const std::string& name, const std::string& file_kitti,
                                const std::string& live_kitti);

/// File and loopback, 1, 2 and 4 threads, an idle computer and a loaded one, a live run out of its budget and
/// what its decision log repeats. `config` as for the runs in real time; folders are made in `folder`.
core::Result<std::vector<IdentityCheck>> check_identities(const SensorDrive& drive, const DrivePart& part,
                                                          const RealtimeRunConfig& config,
                                                          const std::filesystem::path& folder,
                                                          StopSignals& signals);

BenchTable identity_table(std::span<const IdentityCheck> checks);
bool any_failed(std::span<const IdentityCheck> checks);

}  // namespace nilio::tools
