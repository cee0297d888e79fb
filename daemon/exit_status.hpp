#pragma once

namespace nilio {

/// Exit statuses of the programs. kBadResult: everything was done, but the result is bad, such as a replay
/// that lost tracking or a trajectory beyond a threshold.
enum ExitStatus : int { kDone = 0, kFailed = 1, kUsageError = 2, kBadResult = 3 };

}  // namespace nilio
