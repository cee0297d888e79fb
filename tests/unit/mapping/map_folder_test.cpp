#include "mapping/map_folder.hpp"

#include "tests/support/street.hpp"
#include "tests/support/temporary_folder.hpp"

#include <filesystem>
#include <fstream>
#include <vector>

#include <catch2/catch.hpp>

#include "mapping/submap_builder.hpp"

namespace {

using namespace nilio;
using namespace nilio::mapping;
using Catch::Matchers::Contains;
using nilio::tests::street_keyframe;
using nilio::tests::TemporaryFolder;

std::vector<Submap> street_submaps() {
  std::vector<Submap> submaps;
  SubmapBuilder builder({}, [&](const Submap& submap) { submaps.push_back(submap); });
  for (int i = 0; i < 80; ++i) builder.add(street_keyframe(i, 900));
  builder.finish();
  return submaps;
}

MapWriter open_writer(const std::filesystem::path& folder, const std::string& session = "run") {
  auto writer = MapWriter::open(folder, session, {7});
  if (!writer) FAIL(writer.error().message);
  return std::move(writer).value();
}

MapReader open_reader(const std::filesystem::path& folder) {
  auto reader = MapReader::open(folder);
  if (!reader) FAIL(reader.error().message);
  return std::move(reader).value();
}

void write_bytes(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

}  // namespace

TEST_CASE("a map is read as it was written", "[map_folder]") {
  const TemporaryFolder folder;
  const auto submaps = street_submaps();
  {
    MapWriter writer = open_writer(folder.path() / "map");
    CHECK(writer.next_id() == 0);
    for (const Submap& submap : submaps) REQUIRE(writer.write(submap, {8}).ok());
    CHECK(writer.next_id() == submaps.size());
  }
  const MapReader map = open_reader(folder.path() / "map");
  CHECK(map.header().session == "run");
  CHECK(map.header().created.ns == 7);
  CHECK(map.warning().empty());
  REQUIRE(map.submaps().size() == submaps.size());
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    const SubmapEntry& entry = map.submaps()[i];
    CHECK(entry.surfaces == submaps[i].surfaces.size());
    CHECK(entry.keyframes == submaps[i].keyframes.size());
    CHECK(entry.last_stamp.ns == submaps[i].keyframes.back().stamp.ns);
    const auto loaded = map.load(entry);
    REQUIRE(loaded.ok());
    CHECK(loaded->surfaces.size() == submaps[i].surfaces.size());
  }
}

TEST_CASE("the same session continues its map, another one begins anew, and two writers are refused",
          "[map_folder]") {
  const TemporaryFolder folder;
  const auto submaps = street_submaps();
  {
    MapWriter writer = open_writer(folder.path());
    REQUIRE(writer.write(submaps[0], {8}).ok());
    CHECK_THAT(MapWriter::open(folder.path(), "run", {9}).error().message, Contains("another process"));
  }
  write_bytes(folder.path() / "submaps" / "000001.sub", "not listed");
  write_bytes(folder.path() / "submaps" / "000000.sub.tmp.17", "half");
  write_bytes(folder.path() / "submaps" / "notes.txt", "of the user");
  {
    MapWriter writer = open_writer(folder.path());
    CHECK(writer.next_id() == 1);
    CHECK(writer.content().header().created.ns == 7);
    CHECK_FALSE(std::filesystem::exists(folder.path() / "submaps" / "000001.sub"));
    CHECK_FALSE(std::filesystem::exists(folder.path() / "submaps" / "000000.sub.tmp.17"));
    REQUIRE(writer.write(submaps[1], {8}).ok());
  }
  CHECK(open_reader(folder.path()).submaps().size() == 2);
  {
    const MapWriter writer = open_writer(folder.path(), "another run");
    CHECK(writer.next_id() == 0);
  }
  CHECK(open_reader(folder.path()).submaps().empty());
  CHECK(std::filesystem::exists(folder.path() / "submaps" / "notes.txt"));
}

TEST_CASE("a log that ends in the middle of a record is a map up to it, and is continued", "[map_folder]") {
  const TemporaryFolder folder;
  const auto submaps = street_submaps();
  {
    MapWriter writer = open_writer(folder.path());
    for (const Submap& submap : submaps) REQUIRE(writer.write(submap, {8}).ok());
  }
  const auto log = folder.path() / "map.log";
  std::filesystem::resize_file(log, std::filesystem::file_size(log) - 5);
  const MapReader map = open_reader(folder.path());
  CHECK(map.submaps().size() == submaps.size() - 1);
  CHECK_THAT(map.warning(), Contains("damaged bytes"));
  MapWriter writer = open_writer(folder.path());
  CHECK(writer.next_id() == submaps.size() - 1);
  REQUIRE(writer.write(submaps.back(), {8}).ok());
  CHECK(open_reader(folder.path()).warning().empty());
}

TEST_CASE("damaged, exchanged and missing submap files are errors that name them", "[map_folder]") {
  const TemporaryFolder folder;
  const auto submaps = street_submaps();
  {
    MapWriter writer = open_writer(folder.path());
    for (const Submap& submap : submaps) REQUIRE(writer.write(submap, {8}).ok());
  }
  const MapReader map = open_reader(folder.path());
  const auto first = submap_path(folder.path(), 0);
  std::filesystem::copy_file(submap_path(folder.path(), 1), first,
                             std::filesystem::copy_options::overwrite_existing);
  CHECK_THAT(map.load(map.submaps()[0]).error().message, Contains("000000.sub"));
  std::filesystem::remove(first);
  CHECK_THAT(map.load(map.submaps()[0]).error().message, Contains("000000.sub"));
  CHECK_THAT(MapReader::open(folder.path() / "none").error().message, Contains("not a map"));
  write_bytes(folder.path() / "map.log", "rubbish that is no log");
  CHECK_THAT(MapReader::open(folder.path()).error().message, Contains("map.log"));
}

TEST_CASE("open keyframes are read back, continue their file, and go with their stretch", "[map_folder]") {
  const TemporaryFolder folder;
  const MapWriter writer = open_writer(folder.path());
  {
    OpenKeyframes open(folder.path());
    for (int i = 0; i < 6; ++i)
      REQUIRE(open.add(street_keyframe(i, 50), static_cast<std::uint32_t>(i / 2)).ok());
  }
  {
    OpenKeyframes open(folder.path());
    CHECK(open.take(1).size() == 4);  // those of stretch 0 are not needed any more
    REQUIRE(open.add(street_keyframe(6, 50), 2).ok());
  }
  OpenKeyframes open(folder.path());
  const auto keyframes = open.take(1);
  REQUIRE(keyframes.size() == 5);
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    const Keyframe expected = street_keyframe(static_cast<int>(i) + 2, 50);
    CHECK(keyframes[i].stamp.ns == expected.stamp.ns);
    CHECK(keyframes[i].T_odom_base.translation == expected.T_odom_base.translation);
    CHECK(keyframes[i].covariance == expected.covariance);
    REQUIRE(keyframes[i].points.size() == 50);
    for (std::size_t k = 0; k < 50; ++k) {
      CHECK((keyframes[i].points[k].position - expected.points[k].position).cwiseAbs().maxCoeff() <=
            0.00101F);
      CHECK(keyframes[i].points[k].intensity == expected.points[k].intensity);
    }
  }
  open.remove_before(3);
  CHECK(open.take(0).empty());
}

TEST_CASE("poses of loop closure replace those of the odometry, and damage leaves the latter",
          "[map_folder]") {
  const TemporaryFolder folder;
  const auto submaps = street_submaps();
  REQUIRE(submaps.size() > 2);
  MapCorrection correction;
  core::SE3 T_map_odom;
  T_map_odom.rotation = core::so3_exp({0.0, 0.0, 0.1});
  T_map_odom.translation = {1.0, 2.0, 3.0};
  correction.poses = {{0, submaps[0].T_odom_submap}, {1, T_map_odom * submaps[1].T_odom_submap}};
  Loop loop;
  loop.moving = 1;
  loop.verdict = LoopVerdict::kAccepted;
  loop.alignment.information = core::Matrix6::Identity();
  correction.loops.push_back(loop);
  {
    MapWriter writer = open_writer(folder.path());
    for (const Submap& submap : submaps) REQUIRE(writer.write(submap, {8}).ok());
    REQUIRE(writer.write(correction).ok());
  }
  const MapReader map = open_reader(folder.path());
  CHECK(map.warning().empty());
  REQUIRE(map.loops().size() == 1);
  CHECK(map.loops()[0].verdict == LoopVerdict::kAccepted);
  // A submap after the last corrected one follows it.
  for (const std::size_t i : {std::size_t{1}, std::size_t{2}}) {
    const core::SE3 expected = T_map_odom * submaps[i].T_odom_submap;
    CHECK((map.submaps()[i].T_map_submap.translation - expected.translation).norm() < 1e-12);
  }
  CHECK((map.submaps()[0].T_map_submap.translation - submaps[0].T_odom_submap.translation).norm() == 0.0);

  std::ifstream in(folder.path() / "poses", std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), {});
  for (const std::size_t at :
       {std::size_t{0}, std::size_t{8}, std::size_t{20}, bytes.size() / 2, bytes.size() - 1}) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 0x40);
    write_bytes(folder.path() / "poses", damaged);
    const MapReader odometry = open_reader(folder.path());
    CHECK_FALSE(odometry.warning().empty());
    CHECK((odometry.submaps()[1].T_map_submap.translation - submaps[1].T_odom_submap.translation).norm() ==
          0.0);
  }
  for (const std::size_t length : {std::size_t{0}, std::size_t{9}, bytes.size() - 1}) {
    write_bytes(folder.path() / "poses", bytes.substr(0, length));
    CHECK_FALSE(open_reader(folder.path()).warning().empty());
  }
  // Another run begins a new map without it.
  open_writer(folder.path(), "other");
  CHECK_FALSE(std::filesystem::exists(folder.path() / "poses"));
}
