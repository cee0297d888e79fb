#pragma once

#include "tests/support/street.hpp"

#include <filesystem>
#include <utility>

#include <catch2/catch.hpp>

#include "mapping/map_folder.hpp"
#include "mapping/submap_builder.hpp"

namespace nilio::tests {

/// Map of 90 m along the street; with a gap, 10 m of the wall at y = -7.7 are missing.
inline mapping::MapReader street_map(const std::filesystem::path& folder, bool with_gap = false) {
  auto writer = mapping::MapWriter::open(folder, "test", {1});
  if (!writer) FAIL(writer.error().message);
  mapping::SubmapBuilder builder(
      {}, [&](const mapping::Submap& submap) { REQUIRE(writer->write(submap, {2}).ok()); });
  for (int i = 0; i < 90; ++i) {
    mapping::Keyframe keyframe = street_keyframe(i);
    if (with_gap)
      std::erase_if(keyframe.points, [i](const mapping::MapPoint& point) {
        const float x = point.position.x() + static_cast<float>(i);
        return x > 40.0F && x < 50.0F && point.position.y() < -7.9F && point.position.z() > -1.5F;
      });
    builder.add(keyframe);
  }
  builder.finish();
  auto map = mapping::MapReader::open(folder);
  if (!map) FAIL(map.error().message);
  return std::move(map).value();
}

}  // namespace nilio::tests
