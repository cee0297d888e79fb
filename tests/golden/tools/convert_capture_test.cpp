#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/decoder.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/reference_cloud.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/commands/commands.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::TemporaryFolder;

namespace {

namespace fs = std::filesystem;

/// Number of points and weighted sum of each field, by read_points.py; unset without numpy.
struct Digest {
  std::size_t points = 0;
  std::map<std::string, double> sums;
};

std::optional<Digest> read_independently(const fs::path& file) {
  const std::string command = "/usr/bin/python3 " + nilio::tests::source_folder() +
                              "/tests/golden/tools/read_points.py " + file.string();
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  REQUIRE(pipe);
  std::string text;
  for (std::array<char, 256> line{}; std::fgets(line.data(), line.size(), pipe.get()) != nullptr;)
    text += line.data();
  std::istringstream words(text);
  Digest digest;
  if (!(words >> digest.points)) return std::nullopt;
  std::string name;
  for (double sum = 0.0; words >> name >> sum;) digest.sums[name] = sum;
  return digest;
}

bool has_numpy() { return std::system("/usr/bin/python3 -c 'import numpy' 2>/dev/null") == 0; }

Digest digest_of(const core::Scan& scan) {
  Digest digest;
  digest.points = scan.points.size();
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const core::Point& p = scan.points[i];
    const double weight = 1.0 + static_cast<double>(i % 7);
    const auto x = static_cast<double>(p.x);
    const auto y = static_cast<double>(p.y);
    const double azimuth = std::fmod(360.0 - std::atan2(y, x) * kDegreesPerRadian, 360.0);
    const std::array<std::pair<const char*, double>, 8> values{
        {{"x", x},
         {"y", y},
         {"z", static_cast<double>(p.z)},
         {"intensity", static_cast<double>(p.intensity)},
         {"ring", p.ring},
         {"return", p.return_kind},
         {"time", 1e-9 * p.time_offset_ns},
         {"azimuth", azimuth}}};
    for (const auto& [name, value] : values) digest.sums[name] += weight * value;
  }
  return digest;
}

std::vector<core::Scan> decode(const VelodyneSensor& sensor, const std::string& capture) {
  ScanAssembler assembler(sensor, {.min_range_m = 0.0, .max_range_m = 1000.0, .min_coverage = 0.0});
  std::vector<core::Scan> scans = nilio::tests::assemble(assembler, nilio::tests::read_capture(capture));
  if (assembler.finish()) assembler.take_scan(scans.emplace_back());
  return scans;
}

int convert(const std::string& arguments) {
  return nilio::tests::capture_command(tools::add_convert_command, "convert capture " + arguments).status;
}

std::vector<fs::path> clouds_in(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (entry.path().filename().string().starts_with("scan_")) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

}  // namespace

TEST_CASE("captures become point clouds in every format, equal to the decoder's points",
          "[convert_capture]") {
  if (!has_numpy()) {
    WARN("skipped: no numpy");
    return;
  }
  struct Case {
    const char* capture;
    VelodyneModel model;
    bool dual;
  };
  const std::array<Case, 4> cases{{{"golden/vlp16.pcap", VelodyneModel::kVlp16, true},
                                   {"golden/vlp32.pcap", VelodyneModel::kVlp32c, false},
                                   {"golden/vls128.pcap", VelodyneModel::kVls128, false},
                                   {"hdl32e_monterey_stationary.pcap", VelodyneModel::kHdl32e, false}}};
  for (const Case& one : cases) {
    NILIO_REQUIRE_DATA(capture, std::string("velodyne/") + one.capture);
    const std::vector<core::Scan> scans = decode(make_velodyne_sensor(one.model), capture.string());
    for (const std::string format : {"pcd", "ply", "csv"}) {
      CAPTURE(one.capture, format);
      const TemporaryFolder folder;
      REQUIRE(convert(capture.string() + " " + folder.file("out") + " --count 4 --format " + format) == 0);
      const std::vector<fs::path> files = clouds_in(folder.path() / "out");
      REQUIRE(files.size() == std::min<std::size_t>(scans.size(), 4));
      for (std::size_t i = 0; i < files.size(); ++i) {
        CHECK(files[i].extension() == "." + format);
        const auto read = read_independently(files[i]);
        REQUIRE(read.has_value());
        const Digest expected = digest_of(scans[i]);
        REQUIRE(read->points == expected.points);
        REQUIRE(read->sums.size() == 8);
        // Ten digits of a sum of thousands, of floats or of numbers with six decimals.
        const double rounding = 1e-5 * std::sqrt(static_cast<double>(expected.points));
        for (const auto& [name, sum] : expected.sums) {
          CAPTURE(name, i);
          CHECK(read->sums.at(name) == Approx(sum).epsilon(2e-9).margin(rounding));
        }
        CHECK((expected.sums.at("return") > 0.0) == one.dual);
      }
    }
  }
}

TEST_CASE("part of the scans, a wrong format, an earlier conversion and a recording without packets",
          "[convert_capture]") {
  NILIO_REQUIRE_DATA(capture, "velodyne/golden/vlp32.pcap");
  const TemporaryFolder folder;
  const std::string out = folder.file("out");
  CHECK(convert(capture.string() + " " + out + " --first 1 --count 1") == 0);
  REQUIRE(clouds_in(out).size() == 1);
  CHECK(clouds_in(out).front().filename() == "scan_000001.pcd");
  const auto again = nilio::tests::capture_command(tools::add_convert_command,
                                                   "convert capture " + capture.string() + " " + out);
  CHECK(again.status == 1);
  CHECK_THAT(again.errors, Catch::Contains("holds an earlier conversion"));
  CHECK(convert(capture.string() + " " + folder.file("a") + " --format las") == nilio::tests::kNotAccepted);
  CHECK(convert(folder.write("x.pcap", "x") + " " + folder.file("b")) == 1);
  const auto late =
      nilio::tests::capture_command(tools::add_convert_command, "convert capture " + capture.string() + " " +
                                                                    folder.file("c") + " --first 999");
  CHECK(late.status == 1);
  CHECK_THAT(late.errors, Catch::Contains("no scan was written"));
}

TEST_CASE("a calibration file of niliod's configuration moves the points", "[convert_capture]") {
  NILIO_REQUIRE_DATA(capture, "velodyne/golden/vlp16.pcap");
  NILIO_REQUIRE_DATA(calibration, "velodyne/golden/VLP16.yaml");
  const TemporaryFolder folder;
  std::string text = nilio::tests::read_file(calibration.string());
  // The first laser 1 degree up.
  const std::string key = "vert_correction: ";
  const std::size_t at = text.find(key) + key.size();
  REQUIRE(at > key.size());
  const double elevation = std::stod(text.substr(at));
  text.replace(at, text.find_first_of(",}\n", at) - at, std::to_string(elevation + 0.0174532925));
  const std::string changed = folder.write("unit.yaml", text);
  REQUIRE(convert(capture.string() + " " + folder.file("a") + " --count 1") == 0);
  REQUIRE(convert(capture.string() + " " + folder.file("b") +
                  " --count 1 --set lidar.calibration=" + changed) == 0);
  CHECK(nilio::tests::read_file(folder.file("a/scan_000000.pcd")) !=
        nilio::tests::read_file(folder.file("b/scan_000000.pcd")));
}
