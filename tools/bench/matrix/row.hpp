#pragma once

#include "nilio/core/result.hpp"

#include "tools/mangle/faults.hpp"

#include <cstdint>
#include <string>
#include <vector>

namespace nilio::tools::bench {

/// Origin of a drive.
enum class DriveKind {
  kSimulated,
  kKitti04,       ///< odometry sequence 04, frames 0-50: motion-compensated scans
  kKittiRaw0009,  ///< raw drive 0009, scans 0-50: packets
};

/// A drive that rows share. Simulated ones differ in their seed from run to run.
struct DriveSpec {
  std::string name;  ///< the seed is drawn from it
  DriveKind kind = DriveKind::kSimulated;
  std::vector<std::string> options;  ///< of nilio simulate, without seed
};

/// A row of the matrix: a drive, faults, and what nilio may use.
struct MatrixRow {
  std::string name;
  std::string drive;  ///< DriveSpec::name
  bool imu = true;
  mangle::Faults faults;
  /// Largest mean translation error of a success, per cent.
  double bound_percent = 1.0;
};

struct Matrix {
  std::vector<DriveSpec> drives;
  std::vector<MatrixRow> rows;
};

/// Every scene of the simulator with two sensors, with and without an IMU, grades, levels of realism and
/// faults; the real drives and their mangled forms.
Matrix full_matrix();
/// A part of it with short drives, for every change.
Matrix quick_matrix();

/// The rows whose name matches the pattern of a shell (*, ?), and their drives.
Matrix select_rows(Matrix matrix, const std::string& pattern);

/// First 64 bits of SHA-256(commit, drive, run number), so that nobody can choose what a version is measured
/// on.
std::uint64_t draw_seed(const std::string& commit, const std::string& drive, std::size_t run);

/// Name for files: "town_vlp16_no_imu".
std::string slug(const std::string& name);

}  // namespace nilio::tools::bench
