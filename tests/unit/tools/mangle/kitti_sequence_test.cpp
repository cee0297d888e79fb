#include "tests/support/temporary_folder.hpp"
#include "tools/convert/kitti_raw.hpp"
#include "tools/mangle/mangle.hpp"

#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using convert::KittiPoint;
using mangle::Faults;

namespace {

constexpr int kSequenceScans = 10;
constexpr int kRings = 64;
constexpr int kColumns = 90;

/// A cylinder of 20 m radius, 64 rings from the top, each from forward to the left.
std::vector<KittiPoint> cylinder() {
  std::vector<KittiPoint> points;
  for (int ring = 0; ring < kRings; ++ring) {
    for (int column = 0; column < kColumns; ++column) {
      const double yaw = 2.0 * M_PI * (column + 0.5) / kColumns;
      points.push_back({static_cast<float>(20.0 * std::cos(yaw)), static_cast<float>(20.0 * std::sin(yaw)),
                        static_cast<float>(2.0 - 0.2 * ring), 0.5F});
    }
  }
  return points;
}

/// Ten scans, 0.1 s apart, with poses 1 m apart.
class Sequence {
 public:
  Sequence() {
    std::filesystem::create_directories(path() / "velodyne");
    std::ofstream times(path() / "times.txt");
    std::ofstream poses(path() / "poses.txt");
    std::ofstream truth(path() / "truth.tum");
    std::ofstream(path() / "calib.txt") << "Tr: 0 -1 0 0 0 0 -1 0 1 0 0 0\n";
    const std::vector<KittiPoint> points = cylinder();
    for (int i = 0; i < kSequenceScans; ++i) {
      times << 0.1 * i << '\n';
      truth << 0.1 * i << ' ' << i << " 0 0 0 0 0 1\n";
      poses << "1 0 0 0 0 1 0 0 0 0 1 " << i << '\n';
      std::ofstream scan(path() / "velodyne" / ("00000" + std::to_string(i) + ".bin"), std::ios::binary);
      scan.write(reinterpret_cast<const char*>(points.data()),
                 static_cast<std::streamsize>(points.size() * sizeof(KittiPoint)));
    }
  }
  [[nodiscard]] std::filesystem::path path() const { return folder_.path() / "04"; }
  [[nodiscard]] std::filesystem::path out(const std::string& name) const { return folder_.path() / name; }
  [[nodiscard]] core::Result<mangle::Summary> mangled(const std::string& name, const Faults& faults) const {
    return mangle::mangle({path().string(), out(name).string(), faults});
  }

 private:
  tests::TemporaryFolder folder_;
};

std::vector<double> last_column(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::vector<double> values;
  for (std::string line; std::getline(file, line);)
    values.push_back(std::stod(line.substr(line.rfind(' ') + 1)));
  return values;
}

std::vector<KittiPoint> first_scan(const std::filesystem::path& folder) {
  const auto points = convert::read_kitti_scan(folder / "velodyne" / "000000.bin");
  REQUIRE(points);
  return *points;
}

}  // namespace

TEST_CASE("a gap and dropped scans leave scans, times and poses that belong together", "[kitti_sequence]") {
  const Sequence sequence;
  Faults faults;
  faults.gaps = {{0.25, 0.35}};
  const auto gap = sequence.mangled("gap", faults);
  REQUIRE(gap);
  CHECK(gap->scans_dropped == 2);
  CHECK(last_column(sequence.out("gap") / "times.txt") ==
        std::vector<double>{0, 0.1, 0.2, 0.3, 0.6, 0.7, 0.8, 0.9});
  CHECK(last_column(sequence.out("gap") / "poses.txt") == std::vector<double>{0, 1, 2, 3, 6, 7, 8, 9});

  faults = {};
  faults.drop_scans = 2;
  REQUIRE(sequence.mangled("second", faults));
  CHECK(last_column(sequence.out("second") / "poses.txt") == std::vector<double>{0, 2, 4, 6, 8});
}

TEST_CASE("a reversed sequence begins with the last scan and its pose, at increasing times",
          "[kitti_sequence]") {
  const Sequence sequence;
  Faults faults;
  faults.reverse = true;
  REQUIRE(sequence.mangled("reverse", faults));
  CHECK(last_column(sequence.out("reverse") / "poses.txt") ==
        std::vector<double>{9, 8, 7, 6, 5, 4, 3, 2, 1, 0});
  const auto times = last_column(sequence.out("reverse") / "times.txt");
  for (int i = 0; i < kSequenceScans; ++i)
    CHECK(times[static_cast<std::size_t>(i)] == Approx(0.1 * i).margin(1e-9));
  const auto truth = read_trajectory((sequence.out("reverse") / "truth.tum").string());
  REQUIRE(truth);
  for (int i = 0; i < kSequenceScans; ++i) {
    const auto k = static_cast<std::size_t>(i);
    CHECK(truth->stamps[k].seconds() == Approx(0.1 * i).margin(1e-9));
    CHECK(truth->poses[k].translation().x() == Approx(kSequenceScans - 1 - i));
  }
}

TEST_CASE("eight rings of a scan remain, an eighth of its points", "[kitti_sequence]") {
  const Sequence sequence;
  Faults faults;
  faults.rings = 8;
  REQUIRE(sequence.mangled("rings", faults));
  const auto points = first_scan(sequence.out("rings"));
  CHECK(points.size() == 8 * kColumns);
  // Rings from the bottom: 4, 12, ..., so that the lowest point is four rings above the lowest one.
  CHECK(points.back().z == Approx(2.0 - 0.2 * (kRings - 1 - 4)).margin(1e-5));
}

TEST_CASE("noise moves points along their rays", "[kitti_sequence]") {
  const Sequence sequence;
  Faults faults;
  faults.noise_m = 0.3;
  REQUIRE(sequence.mangled("noise", faults));
  const auto before = cylinder();
  const auto after = first_scan(sequence.out("noise"));
  REQUIRE(after.size() == before.size());
  double square = 0.0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    const Eigen::Vector3d a(before[i].x, before[i].y, before[i].z);
    const Eigen::Vector3d b(after[i].x, after[i].y, after[i].z);
    CHECK(a.cross(b).norm() / (a.norm() * b.norm()) < 1e-6);
    square += std::pow(b.norm() - a.norm(), 2.0);
  }
  CHECK(std::sqrt(square / static_cast<double>(after.size())) == Approx(0.3).epsilon(0.03));
}

TEST_CASE("faults of packets are refused for a sequence", "[kitti_sequence]") {
  const Sequence sequence;
  Faults faults;
  faults.loss = 0.1;
  const auto refused = sequence.mangled("loss", faults);
  REQUIRE_FALSE(refused);
  CHECK_THAT(refused.error().message, Catch::Contains("has scans but no packets"));
  faults = {};
  faults.gaps = {{5.0, 0.05}};
  CHECK_THAT(sequence.mangled("all", faults).error().message,
             Catch::Contains("fewer than two scans would remain"));
}

TEST_CASE("vegetation is what lies neither on a plane nor on a line", "[vegetation]") {
  std::vector<mangle::Return> scan;
  // A wall, a pole, and a bush of random points, each in voxels of its own.
  for (int i = 0; i < 200; ++i)
    scan.push_back(
        {{10.5F, 0.01F * static_cast<float>(i), 0.3F + 0.01F * static_cast<float>(i * 37 % 50)}, 0});
  for (int i = 0; i < 20; ++i) scan.push_back({{20.5F, 5.5F, 0.05F * static_cast<float>(i)}, 0});
  const auto unit = [](int i, int step) { return static_cast<float>((i * step) % 101) / 101.0F; };
  for (int i = 0; i < 50; ++i) scan.push_back({{30.0F + unit(i, 37), unit(i, 53), unit(i, 71)}, 0});
  // Too few points to say.
  for (int i = 0; i < 5; ++i) scan.push_back({{40.0F + unit(i, 37), unit(i, 53), unit(i, 71)}, 0});
  const std::vector<bool> vegetation = mangle::find_vegetation(scan);
  for (std::size_t i = 0; i < scan.size(); ++i) {
    INFO(i);
    CHECK(vegetation[i] == (i >= 220 && i < 270));
  }
}
