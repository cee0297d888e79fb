#pragma once

#include "nilio/drivers/can/can_files.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/read_all.hpp"

#include <memory>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

namespace nilio::tests {

/// A CAN recording, read to its end.
struct CanContents {
  std::vector<drivers::CanFrame> frames;
  drivers::SourceState state = drivers::SourceState::kData;
  drivers::SourceStats stats;
  std::string status;
};

inline CanContents contents_of(core::Result<std::unique_ptr<drivers::FrameSource>> source) {
  INFO((source.ok() ? "" : source.error().message));
  REQUIRE(source.ok());
  CanContents contents;
  contents.frames = read_all(**source, 3, &contents.state);
  contents.stats = (*source)->stats();
  contents.status = (*source)->status();
  return contents;
}

/// A text log of this content.
inline CanContents read_can_log(const std::string& text, const std::string& interface_name = "") {
  const TemporaryFile file(text, ".log");
  return contents_of(drivers::open_candump(file.path(), interface_name));
}

}  // namespace nilio::tests
