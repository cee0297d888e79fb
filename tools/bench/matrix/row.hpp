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
  std::string name;
  DriveKind kind = DriveKind::kSimulated;
  std::vector<std::string> options;  ///< of nilio simulate, without seed
  std::string draws_as;              ///< drives with equal names here get equal seeds; empty = `name`
};

/// End of the name of a row without an IMU.
inline constexpr const char* kNoImu = ", no IMU";

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

/// The real drives and their mangled forms; every scene of the simulator with two sensors, ideal and typical,
/// with each grade of IMU and without one; faults of the stream, weather and dirt on chosen ones.
Matrix full_matrix();
/// A part of it with short drives, for every change.
Matrix quick_matrix();
/// The town ideal, with each effect of realism alone, and with all of them: the same seeds, so that runs are
/// paired. With and without an IMU, for two sensors.
Matrix effects_matrix();

/// The rows whose name matches a pattern of a shell (*, ?; several with | between them), and their drives.
Matrix select_rows(Matrix matrix, const std::string& patterns);

/// `count` rows that the commit draws: those with the smallest SHA-256(commit, "row", name). Rows keep their
/// order; the drives come in the order of the draw, so that a run that ends early has a fair part of them.
Matrix draw_rows(Matrix matrix, const std::string& commit, std::size_t count);

/// First 64 bits of SHA-256(commit, drive, run number), so that nobody can choose what a version is measured
/// on.
std::uint64_t draw_seed(const std::string& commit, const std::string& drive, std::size_t run);

/// The commit that is measured: given, or that of the working folder, or the version.
std::string find_commit(const std::string& given);

/// Name for files: "town_vlp16_no_imu".
std::string slug(const std::string& name);

}  // namespace nilio::tools::bench
