#pragma once

#include "nilio/core/result.hpp"

#include "tools/bench/matrix/row.hpp"

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <string>

namespace nilio::tools::bench {

/// Sources of the drives.
struct DriveSources {
  std::filesystem::path data;   ///< real recordings; empty = none
  std::filesystem::path nilio;  ///< the program that simulates and converts
};

/// Whether the drive can be made: real ones need their recordings.
bool is_available(const DriveSpec& drive, const DriveSources& sources);

/// Makes the drive in `folder`, which must not exist, with truth.tum in it: the poses of base_link.
/// Simulation and conversion run as processes, so that a crash is a failed run. Fails with the last line of
/// such a process, or when `stop` is set.
core::Result<std::monostate> make_drive(const DriveSpec& drive, std::uint64_t seed,
                                        const DriveSources& sources, const std::filesystem::path& folder,
                                        const std::atomic<bool>& stop);

/// SHA-256 of the names and contents of all files of a drive.
core::Result<std::string> hash_drive(const std::filesystem::path& folder);

}  // namespace nilio::tools::bench
