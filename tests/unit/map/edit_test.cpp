#include "tools/map/edit.hpp"

#include "tests/support/street_map.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tools/map/render.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <set>
#include <vector>

#include <catch2/catch.hpp>

#include "mapping/map_recovery.hpp"
#include "mapping/submap_builder.hpp"

namespace {

using namespace nilio;
using namespace nilio::tools;
using namespace nilio::tools::map;
using Catch::Matchers::Contains;
using mapping::MapReader;
using tests::street_map;

}  // namespace

TEST_CASE("the summary of a map has its path, number of keyframes and extent", "[edit]") {
  const tests::TemporaryFolder folder;
  const auto summary = summarise(street_map(folder.path() / "map"));
  REQUIRE(summary.ok());
  CHECK(summary->keyframes == 90);
  CHECK(summary->path_m == Approx(89.0));
  CHECK(summary->submaps == 4);
  CHECK(summary->bounds.minimum.y() == Approx(-7.7).margin(0.01));
  CHECK(summary->bounds.maximum.y() == Approx(8.3).margin(0.01));
  CHECK(summary->bounds.minimum.z() == Approx(0.0).margin(0.01));
  CHECK(summary->megabytes > 0.05);
}

TEST_CASE("the cropped parts of a map have all of its surfaces, and are merged to the same number",
          "[edit]") {
  const tests::TemporaryFolder folder;
  const MapReader map = street_map(folder.path() / "map");
  const auto whole = read_cloud(map);
  REQUIRE(whole.ok());
  const double split = 40.001;
  REQUIRE(crop(map, {{-1e3, -1e3, -1e3}, {split, 1e3, 1e3}}, folder.path() / "left").ok());
  REQUIRE(crop(map, {{split, -1e3, -1e3}, {1e3, 1e3, 1e3}}, folder.path() / "right").ok());
  std::vector<MapReader> parts;
  for (const char* const name : {"left", "right"}) {
    auto part = MapReader::open(folder.path() / name);
    REQUIRE(part.ok());
    parts.push_back(std::move(part).value());
  }
  const auto left = read_cloud(parts[0]);
  REQUIRE(left.ok());
  CHECK(std::all_of(left->begin(), left->end(),
                    [&](const CloudPoint& p) { return p.position.x() <= split + 0.003; }));
  REQUIRE(merge(parts, folder.path() / "whole").ok());
  const auto merged = MapReader::open(folder.path() / "whole");
  REQUIRE(merged.ok());
  const auto cloud = read_cloud(*merged);
  REQUIRE(cloud.ok());
  CHECK(cloud->size() == whole->size());
  CHECK_THAT(merge(parts, folder.path() / "whole").error().message, Contains("holds a map already"));
  CHECK_THAT(crop(map, {{900, 900, 900}, {901, 901, 901}}, folder.path() / "none").error().message,
             Contains("no surface"));
}

TEST_CASE("the difference of two maps is the piece of wall that one of them lacks", "[edit]") {
  const tests::TemporaryFolder folder;
  const MapReader map = street_map(folder.path() / "map");
  const MapReader gap = street_map(folder.path() / "gap", true);
  const auto same = diff(map, map, 25.0);
  REQUIRE(same.ok());
  CHECK(same->only_first + same->only_second == 0);
  CHECK(same->distance_rms_m == 0.0);
  const auto difference = diff(map, gap, 25.0);
  REQUIRE(difference.ok());
  CHECK(difference->only_second == 0);
  REQUIRE(difference->only_first > 50);
  for (const CloudPoint& point : difference->changes) {
    CHECK(point.intensity == 0.0F);
    CHECK(point.position.x() > 39.0);
    CHECK(point.position.x() < 51.0);
    CHECK(point.position.y() < -7.0);
  }
}

TEST_CASE("a map whose mapper was killed is completed from the keyframes of its open submaps", "[edit]") {
  const tests::TemporaryFolder folder;
  const auto whole = summarise(street_map(folder.path() / "map"));
  REQUIRE(whole.ok());
  const auto broken = folder.path() / "broken";
  {
    auto writer = mapping::MapWriter::open(broken, "test", {1});
    REQUIRE(writer.ok());
    mapping::OpenKeyframes open(broken);
    mapping::SubmapBuilder builder({}, [&](const mapping::Submap& submap) {
      REQUIRE(writer->write(submap, {2}).ok());
      open.remove_before(submap.id + 1);
    });
    for (int i = 0; i < 90; ++i) {
      const mapping::Keyframe keyframe = tests::street_keyframe(i);
      REQUIRE(open.add(keyframe, builder.add(keyframe)).ok());
    }
    CHECK_THAT(mapping::recover_map(broken, {}).error().message, Contains("another process writes this map"));
  }
  const auto before = summarise(MapReader::open(broken).value());
  REQUIRE(before.ok());
  CHECK(before->keyframes < 80);
  CHECK(mapping::OpenKeyframes(broken).count() >= 90 - before->keyframes);
  const auto recovered = mapping::recover_map(broken, {});
  REQUIRE(recovered.ok());
  CHECK(*recovered >= 90 - before->keyframes);
  const auto after = summarise(MapReader::open(broken).value());
  REQUIRE(after.ok());
  CHECK(after->keyframes == 90);
  CHECK(after->submaps == whole->submaps);
  // Irregular surfaces of the stored submap may be stored twice.
  CHECK(static_cast<double>(after->surfaces) == Approx(static_cast<double>(whole->surfaces)).epsilon(0.05));
  CHECK(mapping::OpenKeyframes(broken).count() == 0);
  CHECK(mapping::recover_map(broken, {}).value() == 0);
  CHECK_FALSE(mapping::recover_map(folder.path() / "nothing", {}).ok());
}

TEST_CASE("a picture from above shows walls and ground where they are, and colours what is high differently",
          "[render]") {
  const tests::TemporaryFolder folder;
  const MapReader map = street_map(folder.path() / "map");
  const auto cloud = read_cloud(map);
  REQUIRE(cloud.ok());
  RenderOptions options;
  options.width_px = 600;
  const plot::Raster raster = render(*cloud, options);
  REQUIRE(raster.width == 600);
  CHECK(raster.height > 60);
  CHECK(raster.height < 200);
  const std::uint32_t background = raster.pixels.front();
  const auto column = [&](int x) {
    std::set<std::uint32_t> colours;
    for (int y = 0; y < raster.height; ++y)
      colours.insert(raster.pixels[static_cast<std::size_t>(y * raster.width + x)]);
    return colours;
  };
  CHECK(column(1).size() == 1);
  CHECK(column(300).size() > 3);
  const auto drawn = std::count_if(raster.pixels.begin(), raster.pixels.end(),
                                   [&](std::uint32_t pixel) { return pixel != background; });
  CHECK(drawn > 600 * 40);
  options.view = View::kOblique;
  CHECK(render(*cloud, options).height != raster.height);
  CHECK(render({}, options).pixels.empty());
  const auto path = read_path(map);
  REQUIRE(path.ok());
  REQUIRE(render_png(*cloud, *path, options, folder.file("map.png")).ok());
  CHECK(std::filesystem::file_size(folder.file("map.png")) > 5000);
  CHECK_FALSE(render_png(*cloud, *path, options, folder.file("map.jpg")).ok());
}
