#pragma once

#include <string>
#include <string_view>

namespace nilio {

/// Exit statuses of the programs. kBadResult: everything was done, but a threshold is missed, such as a
/// replay that ends without tracking.
enum ExitStatus : int { kDone = 0, kFailed = 1, kUsageError = 2, kBadResult = 3 };

/// "Exit status:" and one line per status of a program or command such as "niliod" or "nilio evaluate"; the
/// general meanings for "nilio". For help texts.
std::string exit_status_help(std::string_view command);

/// The statuses of all commands as Markdown; docs/exit_status.md is this text.
std::string exit_status_reference();

}  // namespace nilio
