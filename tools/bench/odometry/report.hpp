#pragma once

#include "tools/bench/odometry/measure.hpp"
#include "tools/bench/odometry/table.hpp"

#include <span>
#include <string>

namespace nilio::tools {

/// Errors of each method.
BenchTable accuracy_table(std::span<const Measurement> measurements);
/// Are errors as large as covariances say? Methods whose truth does not tell are left out.
BenchTable consistency_table(std::span<const Measurement> measurements);
/// Time, memory and allocations of each run.
BenchTable cost_table(std::span<const Measurement> measurements);
/// Median time of each stage.
BenchTable stage_table(std::span<const Measurement> measurements);
/// What registration had to do.
BenchTable work_table(std::span<const Measurement> measurements);
/// Which runs gave the same trajectory.
BenchTable hash_table(std::span<const Measurement> measurements);

/// "ndt_icp, 2 threads".
std::string label_of(const Measurement& measurement);

/// Machine, compiler and date of a page of results.
std::string describe_machine();
/// The command line of this process, quoted where a shell needs it.
std::string command_line();

}  // namespace nilio::tools
