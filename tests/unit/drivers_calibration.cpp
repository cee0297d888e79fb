#include "drivers_support.hpp"
#include "test_data.hpp"

#include <numbers>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::TemporaryFile;

namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

/// A calibration of 16 lasers with one line replaced.
std::string calibration(std::size_t laser, const std::string& line) {
  std::string text = "lasers:\n";
  for (std::size_t id = 0; id < 16; ++id) {
    const std::string number = std::to_string(id);
    text += id == laser
                ? line + "\n"
                : "  - {laser_id: " + number + ", rot_correction: 0.0, vert_correction: 0.0" + number + "}\n";
  }
  return text;
}

std::string error_of(const std::string& text) {
  const TemporaryFile file(text, ".yaml");
  const auto sensor = with_calibration_file(make_velodyne_sensor(VelodyneModel::kVlp16), file.path());
  REQUIRE_FALSE(sensor.ok());
  CHECK_THAT(sensor.error().message, Contains(file.path()));
  return sensor.error().message;
}

}  // namespace

TEST_CASE("model names are understood however they are written") {
  CHECK(parse_velodyne_model("vlp16") == VelodyneModel::kVlp16);
  CHECK(parse_velodyne_model("VLP-16") == VelodyneModel::kVlp16);
  CHECK(parse_velodyne_model("hdl_64e_s2") == VelodyneModel::kHdl64eS2);
  CHECK_FALSE(parse_velodyne_model("VLP-32C").has_value());
  for (const VelodyneModel model : {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS2}) {
    CHECK(parse_velodyne_model(velodyne_model_name(model)) == model);
  }
}

TEST_CASE("the calibration file of KITTI's scanner is the built-in one") {
  const VelodyneSensor built_in = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  VelodyneSensor blank = built_in;
  blank.lasers.assign(64, {});
  const auto loaded = with_calibration_file(
      blank, std::string(NILIO_SOURCE_DIR) + "/config/calibration/hdl64e_s2_kitti.yaml");
  REQUIRE(loaded.ok());
  for (std::size_t i = 0; i < 64; ++i) {
    const LaserCalibration& a = built_in.lasers[i];
    const LaserCalibration& b = loaded->lasers[i];
    CHECK(b.elevation_rad == Approx(a.elevation_rad).margin(1e-8));
    CHECK(b.azimuth_correction_rad == Approx(a.azimuth_correction_rad).margin(1e-8));
    CHECK(b.distance_correction_m == Approx(a.distance_correction_m).margin(1e-9));
    CHECK(b.vertical_offset_m == Approx(a.vertical_offset_m));
    CHECK(b.horizontal_offset_m == Approx(a.horizontal_offset_m));
    CHECK(b.ring == a.ring);
  }
  CHECK(loaded->beam_spacing_rad == Approx(built_in.beam_spacing_rad));
}

TEST_CASE("calibration files of the ROS driver are read") {
  NILIO_REQUIRE_DATA(folder, "velodyne/golden");
  const VelodyneSensor vlp16 = make_velodyne_sensor(VelodyneModel::kVlp16);
  const auto loaded = with_calibration_file(vlp16, (folder / "VLP16.yaml").string());
  REQUIRE(loaded.ok());
  for (std::size_t i = 0; i < 16; ++i) {
    CHECK(loaded->lasers[i].elevation_rad == Approx(vlp16.lasers[i].elevation_rad));
    CHECK(loaded->lasers[i].vertical_offset_m == 0.0);
    CHECK(loaded->lasers[i].ring == vlp16.lasers[i].ring);
  }
  for (const char* name : {"HDL64e_s2.yaml", "HDL64e_s3.yaml"}) {
    const auto hdl =
        with_calibration_file(make_velodyne_sensor(VelodyneModel::kHdl64eS2), (folder / name).string());
    REQUIRE(hdl.ok());
    CHECK(hdl->lasers[0].distance_correction_m > 1.0);
    CHECK(std::abs(hdl->lasers[0].horizontal_offset_m) == Approx(0.026));
    CHECK(hdl->beam_spacing_rad > 0.2 * kDegree);
    CHECK(hdl->beam_spacing_rad < 0.7 * kDegree);
  }
  const auto wrong = with_calibration_file(vlp16, (folder / "VLP32.yaml").string());
  REQUIRE_FALSE(wrong.ok());
  CHECK_THAT(wrong.error().message, Contains("32 lasers") && Contains("VLP-16 has 16"));
}

TEST_CASE("errors in a calibration name the line and the key") {
  CHECK_THAT(error_of(calibration(3, "  - {laser_id: 3, rot_corection: 0.0, vert_correction: 0.0}")),
             Contains(":5: this laser has no rot_correction"));
  CHECK_THAT(error_of(calibration(
                 3, "  - {laser_id: 3, rot_correction: 0, vert_correction: 0, vert_ofset_correction: 0}")),
             Contains(":5: unknown key") && Contains("did you mean 'vert_offset_correction'"));
  CHECK_THAT(error_of(calibration(0, "  - {laser_id: 0, rot_correction: 0, vert_correction: -15.0}")),
             Contains(":2: vert_correction is -15.0") && Contains("radians"));
  CHECK_THAT(error_of(calibration(0, "  - {laser_id: 0, rot_correction: 0, vert_correction: .nan}")),
             Contains("vert_correction is not a number"));
  CHECK_THAT(error_of(calibration(
                 0, "  - {laser_id: 0, rot_correction: 0, vert_correction: 0, dist_correction: 152}")),
             Contains("metres"));
  CHECK_THAT(error_of(calibration(4, "  - {laser_id: 3, rot_correction: 0, vert_correction: 0}")),
             Contains("3 is there twice"));
  CHECK_THAT(error_of(calibration(4, "  - {laser_id: 16, rot_correction: 0, vert_correction: 0}")),
             Contains("0..15"));
  CHECK_THAT(error_of(calibration(4, "  - 7")), Contains("expected a laser"));
  CHECK_THAT(error_of("lasers: [1, 2"), Contains(":1"));
  CHECK_THAT(error_of("hello"), Contains("no list 'lasers'"));
  CHECK_THAT(error_of(""), Contains("no list 'lasers'"));
  const auto missing =
      with_calibration_file(make_velodyne_sensor(VelodyneModel::kVlp16), "/nonexistent.yaml");
  REQUIRE_FALSE(missing.ok());
  CHECK_THAT(missing.error().message, Contains("/nonexistent.yaml") && Contains("cannot be read"));
}
