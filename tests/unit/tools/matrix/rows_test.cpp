#include "tools/bench/matrix/row.hpp"
#include "tools/simulate/scenes/scene.hpp"

#include <algorithm>
#include <set>
#include <string>

#include <catch2/catch.hpp>

using namespace nilio::tools;
using namespace nilio::tools::bench;

TEST_CASE("a seed is the first 64 bits of the SHA-256 of commit, drive and run number", "[rows]") {
  // printf 'abc123town vlp161' | sha256sum
  CHECK(draw_seed("abc123", "town vlp16", 1) == 473708293697578180U);
  CHECK(draw_seed("abc123", "town vlp16", 12) == 15629122945818141636U);
  CHECK(draw_seed("abc124", "town vlp16", 1) != draw_seed("abc123", "town vlp16", 1));
}

TEST_CASE("every row has a drive of its own name's beginning, and no two rows or files share a name",
          "[rows]") {
  for (const Matrix& matrix : {full_matrix(), quick_matrix()}) {
    std::set<std::string> drives;
    for (const DriveSpec& drive : matrix.drives) CHECK(drives.insert(drive.name).second);
    std::set<std::string> names;
    std::set<std::string> slugs;
    for (const MatrixRow& row : matrix.rows) {
      INFO(row.name);
      CHECK(names.insert(row.name).second);
      CHECK(slugs.insert(slug(row.name)).second);
      CHECK(drives.contains(row.drive));
      CHECK(row.name.starts_with(row.drive));
      CHECK(row.bound_percent > 0.0);
      const bool has_faults =
          row.faults.changes_packets() || row.faults.changes_scans() || row.faults.changes_returns();
      if (has_faults) CHECK(mangle::check_faults(row.faults));
    }
  }
}

TEST_CASE("the full matrix has every scene of the simulator, and the quick one real drives", "[rows]") {
  const Matrix full = full_matrix();
  for (const simulate::SceneInfo& scene : simulate::scene_infos()) {
    INFO(scene.name);
    CHECK_FALSE(select_rows(full, std::string(scene.name) + " vlp16*").rows.empty());
    CHECK_FALSE(select_rows(full, std::string(scene.name) + " hdl64e*").rows.empty());
  }
  CHECK(select_rows(quick_matrix(), "KITTI*").drives.size() == 2);
}

TEST_CASE("a pattern selects rows and the drives that they need", "[rows]") {
  const Matrix rows = select_rows(full_matrix(), "town vlp16 ideal*, no IMU");
  REQUIRE(rows.drives.size() == 1);
  CHECK(rows.drives.front().name == "town vlp16 ideal");
  for (const MatrixRow& row : rows.rows) CHECK_FALSE(row.imu);
  CHECK(select_rows(full_matrix(), "nowhere").rows.empty());
  const Matrix two = select_rows(full_matrix(), "KITTI 04|town hdl64e poor");
  REQUIRE(two.rows.size() == 2);
  CHECK(two.rows[0].name == "KITTI 04");
  CHECK(two.rows[1].name == "town hdl64e poor");
}

TEST_CASE("the matrix has typical rows with each grade of IMU and without one, the quick one some",
          "[rows]") {
  const Matrix full = full_matrix();
  for (const simulate::SceneInfo& scene : simulate::scene_infos()) {
    for (const char* grade : {"consumer", "automotive", "industrial", "tactical", "industrial, no IMU"}) {
      INFO(scene.name << " " << grade);
      CHECK(select_rows(full, std::string(scene.name) + " vlp16 typical " + grade).rows.size() == 1);
      CHECK(select_rows(full, std::string(scene.name) + " hdl64e typical " + grade).rows.size() == 1);
    }
  }
  CHECK(select_rows(quick_matrix(), "*vlp16 typical*").rows.size() >= 4);
  CHECK(select_rows(quick_matrix(), "*hdl64e typical*").rows.size() >= 2);
}

TEST_CASE("the commit draws the rows of a part, and a larger part contains the smaller one", "[rows]") {
  const Matrix full = full_matrix();
  const auto names = [](const Matrix& matrix) {
    std::set<std::string> result;
    for (const MatrixRow& row : matrix.rows) result.insert(row.name);
    return result;
  };
  const auto small = names(draw_rows(full, "abc", 20));
  const auto large = names(draw_rows(full, "abc", 60));
  CHECK(small.size() == 20);
  CHECK(large.size() == 60);
  CHECK(std::includes(large.begin(), large.end(), small.begin(), small.end()));
  CHECK(names(draw_rows(full, "abd", 20)) != small);
  CHECK(names(draw_rows(full, "abc", 100'000)) == names(full));
  // Only drives of drawn rows remain.
  const Matrix part = draw_rows(full, "abc", 20);
  for (const DriveSpec& drive : part.drives)
    CHECK(std::any_of(part.rows.begin(), part.rows.end(),
                      [&](const MatrixRow& row) { return row.drive == drive.name; }));
}

TEST_CASE("names for files have only letters, digits and underscores", "[rows]") {
  CHECK(slug("KITTI raw 0009, no IMU, gap 0.5 s") == "kitti_raw_0009_no_imu_gap_0.5_s");
}
