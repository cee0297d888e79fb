#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/common/sensor_drive.hpp"
#include "tools/bench/realtime/live_run.hpp"
#include "tools/bench/report/results_page.hpp"
#include "tools/common/system.hpp"

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Comparison of two runs that have to give the same poses, bit by bit.
struct IdentityCheck {
  enum class Verdict : std::uint8_t {
    kPass,
    kFail,
    kNotComparable,  ///< the runs did not get the same input; `remark` says why
  };
  std::string name;
  Verdict verdict = Verdict::kFail;
  /// SHA-256 of trajectory.kitti, or of the lines that both have.
  std::string first;
  std::string second;
  std::string remark;
};

/// SHA-256 of the first `lines` lines of a text, or of the whole text when it has fewer.
std::string sha256_of_lines(const std::string& text, std::size_t lines);

/// Compares the poses of a live run with those of the file. The file may have one pose more: the end of a
/// live stream does not complete its last scan. The check fails without poses.
IdentityCheck compare_with_file(const std::string& name, const std::string& file_kitti,
                                const std::string& live_kitti);

/// Compares file and loopback; 1, 2 and 4 threads; an idle and a loaded computer; an overloaded live run and
/// the replay of its decision log. `config` as for live runs; creates folders in `folder`.
core::Result<std::vector<IdentityCheck>> check_identities(const SensorDrive& drive, const DrivePart& part,
                                                          const RealtimeRunConfig& config,
                                                          const std::filesystem::path& folder,
                                                          StopSignals& signals);

Table identity_table(std::span<const IdentityCheck> checks);
bool any_failed(std::span<const IdentityCheck> checks);

}  // namespace nilio::tools::bench
