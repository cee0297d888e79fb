// Folders of the build that runs. Their names are compiled into one file, so that builds in different folders
// share the objects of all others in a compiler cache.
#pragma once

#include <string>

namespace nilio::tests {

/// Root of the sources, without a slash at the end.
std::string source_folder();

/// Folder of the programs that were built, without a slash at the end.
std::string program_folder();

}  // namespace nilio::tests
