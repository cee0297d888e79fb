#pragma once

#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"

#include <string>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// Simulates a drive through the town in the folder; its path.
inline std::string simulate_town(const TemporaryFolder& folder, const std::string& seconds) {
  const std::string drive = folder.file("town");
  REQUIRE(run_command(tools::add_simulate_command, {"simulate", drive, "--realism", "ideal", "--duration",
                                                    seconds, "--moving-start"}) == 0);
  return drive;
}

/// Five seconds through the town, simulated once a process.
inline const std::string& town_drive() {
  static const TemporaryFolder folder;
  static const std::string path = simulate_town(folder, "5");
  return path;
}

}  // namespace nilio::tests
