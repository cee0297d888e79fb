#include "tests/support/paths.hpp"

namespace nilio::tests {

std::string source_folder() { return NILIO_SOURCE_DIR; }

std::string program_folder() { return NILIO_BIN_DIR; }

}  // namespace nilio::tests
