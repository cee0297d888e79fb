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

}  // namespace nilio::daemon
