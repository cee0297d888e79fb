#pragma once

#include "nilio/core/result.hpp"

#include <string>

namespace nilio::daemon {

enum class EarlierRun {
  kRefuse,     ///< fails, so that no result is lost or taken for another
  kKeep,       ///< takes FOLDER-2, FOLDER-3, ... instead: a live run always starts
  kOverwrite,  ///< removes its files
};

/// Folder for the files of a run that was told to write to `folder`, which may hold an earlier run. An empty
/// name stays empty.
core::Result<std::string> choose_output_folder(const std::string& folder, EarlierRun earlier);

/// Folder of the last run that was told to write to `folder` and has a map, if it was killed: it has no
/// report. Else empty.
std::string find_killed_run(const std::string& folder);

}  // namespace nilio::daemon
