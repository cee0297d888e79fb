#include "nilio/core/units.hpp"
#include "nilio/drivers/velodyne/model.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"

#include <algorithm>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using Catch::Matchers::Contains;
using nilio::tests::TemporaryFile;

namespace {

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

/// Rows of an HDL-64E S2.1's db.xml, in its units (degrees, centimetres).
struct XmlRow {
  int id;
  double rot, vert, dist, dist_x, dist_y, vert_offset, horiz_offset, focal_distance, focal_slope;
  int min_intensity, max_intensity;
};

const std::vector<XmlRow> kXmlRows{
    {0, -7.1559, -8.7686, 151.953, 155.003, 152.314, 19.548, 2.6, 1200, 1.4, 30, 235},
    {3, 7.8958, 2.9771, 137.712, 141.038, 143.435, 21.031, -2.6, 950, 1.1, 20, 255},
    {19, 1.393, -4.1689, 145.659, 143.406, 145.505, 20.133, -2.6, 2000, 0.7, 30, 255},
    {31, 1.4631, 1.9718, 139.077, 143.652, 145.014, 20.905, -2.6, 900, 1, 5, 255},
    {32, -7.626, -22.7272, 134.618, 136.785, 135.529, 10.812, 2.6, 1100, 1.5, 45, 255},
    {44, -7.4476, -16.554, 124.074, 131.715, 128.364, 11.568, 2.6, 1500, 1.6, 0, 220},
    {61, 2.5722, -9.0717, 135.855, 141.352, 141.705, 12.423, -2.6, 200, 0.9, 0, 255},
};

/// Row of a laser; an interpolated one for lasers that are not in the table.
XmlRow xml_row(int id) {
  const auto found =
      std::find_if(kXmlRows.begin(), kXmlRows.end(), [&](const auto& r) { return r.id == id; });
  if (found != kXmlRows.end()) return *found;
  return {id, 0.0, 2.0 - 0.4 * id, 140.0, 141.0, 142.0, 20.0, id % 2 == 0 ? 2.6 : -2.6, 1000.0, 1.0, 10, 255};
}

std::string tag(const std::string& name, const std::string& content) {
  return "<" + name + ">" + content + "</" + name + ">\n";
}

/// A db.xml in the form of Velodyne's software, one line per element.
std::string db_xml(const std::vector<int>& disabled = {}) {
  std::string enabled, lowest, highest, points;
  for (int id = 0; id < 64; ++id) {
    const XmlRow r = xml_row(id);
    const bool off = std::find(disabled.begin(), disabled.end(), id) != disabled.end();
    enabled += tag("item", off ? "0" : "1");
    lowest += tag("item", std::to_string(r.min_intensity));
    highest += tag("item", std::to_string(r.max_intensity));
    const auto number = [](const char* name, double value) { return tag(name, std::to_string(value)); };
    points +=
        tag("item",
            tag("px", tag("id_", std::to_string(id)) + number("rotCorrection_", r.rot) +
                          number("vertCorrection_", r.vert) + number("distCorrection_", r.dist) +
                          number("distCorrectionX_", r.dist_x) + number("distCorrectionY_", r.dist_y) +
                          number("vertOffsetCorrection_", r.vert_offset) +
                          number("horizOffsetCorrection_", r.horiz_offset) +
                          number("focalDistance_", r.focal_distance) + number("focalSlope_", r.focal_slope)));
  }
  const std::string count = tag("count", "64") + tag("item_version", "0");
  return "<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"yes\" ?>\n<!DOCTYPE boost_serialization>\n"
         "<boost_serialization signature=\"serialization::archive\" version=\"4\">\n<DB class_id=\"0\" "
         "version=\"1\">\n" +
         tag("distLSB_", "2.00000003e-001") + tag("enabled_", count + enabled) +
         tag("minIntensity_", count + lowest) + tag("maxIntensity_", count + highest) +
         tag("points_", count + points) + "</DB>\n</boost_serialization>\n";
}

/// Error of a db.xml in which the first `from` after `after` is replaced.
std::string xml_error(const std::string& after, const std::string& from, const std::string& to) {
  std::string text = db_xml();
  const std::size_t at = text.find(from, text.find(after));
  REQUIRE(at != std::string::npos);
  text.replace(at, from.size(), to);
  const TemporaryFile file(text, ".xml");
  const auto sensor = with_calibration_file(make_velodyne_sensor(VelodyneModel::kHdl64eS2), file.path());
  REQUIRE_FALSE(sensor.ok());
  CHECK_THAT(sensor.error().message, Contains(file.path()));
  return sensor.error().message;
}

}  // namespace

TEST_CASE("model names are parsed in any spelling", "[calibration]") {
  CHECK(parse_velodyne_model("vlp16") == VelodyneModel::kVlp16);
  CHECK(parse_velodyne_model("VLP-16") == VelodyneModel::kVlp16);
  CHECK(parse_velodyne_model("hdl_64e_s2") == VelodyneModel::kHdl64eS2);
  CHECK(parse_velodyne_model("vlp 32c") == VelodyneModel::kVlp32c);
  CHECK(parse_velodyne_model("Alpha Prime") == VelodyneModel::kVls128);
  CHECK_FALSE(parse_velodyne_model("OS1-64").has_value());
  for (const VelodyneModel model : {VelodyneModel::kVlp16, VelodyneModel::kHdl64eS2}) {
    CHECK(parse_velodyne_model(velodyne_model_name(model)) == model);
  }
}

TEST_CASE("the calibration file of KITTI's scanner equals the built-in one", "[calibration]") {
  const VelodyneSensor built_in = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  VelodyneSensor blank = built_in;
  blank.lasers.assign(64, {});
  const auto loaded = with_calibration_file(
      blank, nilio::tests::source_folder() + "/config/calibration/hdl64e_s2_kitti.yaml");
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

TEST_CASE("calibration files of the ROS driver are read", "[calibration]") {
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
    CHECK(hdl->lasers[0].near_distance_correction_x_m > 1.0);
    CHECK(hdl->lasers[0].near_distance_correction_y_m > 1.0);
    CHECK(hdl->lasers[0].focal_distance_m > 10.0);
    CHECK(hdl->lasers[0].focal_slope > 1.0);
    CHECK(hdl->lasers[0].min_intensity > 0);
    CHECK(disabled_lasers(*hdl).empty());
    CHECK(std::abs(hdl->lasers[0].horizontal_offset_m) == Approx(0.026));
    CHECK(hdl->beam_spacing_rad > 0.2 * nilio::kRadiansPerDegree);
    CHECK(hdl->beam_spacing_rad < 0.7 * nilio::kRadiansPerDegree);
  }
  const auto wrong = with_calibration_file(vlp16, (folder / "VLP32.yaml").string());
  REQUIRE_FALSE(wrong.ok());
  CHECK_THAT(wrong.error().message, Contains("32 lasers") && Contains("VLP-16 has 16"));
}

TEST_CASE("errors in a calibration name the line and the key", "[calibration]") {
  CHECK_THAT(error_of(calibration(3, "  - {laser_id: 3, rot_corection: 0.0, vert_correction: 0.0}")),
             Contains(":5: laser 3: has no rot_correction"));
  CHECK_THAT(error_of(calibration(
                 3, "  - {laser_id: 3, rot_correction: 0, vert_correction: 0, vert_ofset_correction: 0}")),
             Contains(":5: laser 3: unknown key") && Contains("did you mean 'vert_offset_correction'"));
  CHECK_THAT(error_of(calibration(0, "  - {laser_id: 0, rot_correction: 0, vert_correction: -15.0}")),
             Contains(":2: laser 0: vert_correction is -15") && Contains("radians"));
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

TEST_CASE("errors in the values of a calibration name the laser", "[calibration]") {
  const auto with = [](const std::string& extra) {
    return error_of(
        calibration(7, "  - {laser_id: 7, rot_correction: 0, vert_correction: 0, " + extra + "}"));
  };
  CHECK_THAT(with("focal_distance: 1200"),
             Contains(":9: laser 7: focal_distance is 1200") && Contains("metres"));
  CHECK_THAT(with("focal_slope: -1"), Contains("laser 7: focal_slope is -1"));
  CHECK_THAT(with("dist_correction_x: 155.0"), Contains("laser 7: dist_correction_x") && Contains("metres"));
  CHECK_THAT(with("min_intensity: 256"), Contains("laser 7: min_intensity is not a whole number"));
  CHECK_THAT(with("max_intensity: 3.5"), Contains("laser 7: max_intensity is not a whole number"));
  CHECK_THAT(with("min_intensity: 9, max_intensity: 8"), Contains("laser 7: its smallest intensity (9)"));
  CHECK_THAT(with("two_pt_correction_available: perhaps"), Contains("neither true nor false"));
}

TEST_CASE("near corrections marked unavailable in the file are not used", "[calibration]") {
  const TemporaryFile file(
      calibration(2,
                  "  - {laser_id: 2, rot_correction: 0, vert_correction: 0, dist_correction_x: 1.5, "
                  "dist_correction_y: 1.5, two_pt_correction_available: false}"),
      ".yaml");
  const auto sensor = with_calibration_file(make_velodyne_sensor(VelodyneModel::kVlp16), file.path());
  REQUIRE(sensor.ok());
  CHECK(sensor->lasers[2].near_distance_correction_x_m == 0.0);
  CHECK(sensor->lasers[2].near_distance_correction_y_m == 0.0);
  CHECK(sensor->lasers[2].min_intensity == 0);
  CHECK(sensor->lasers[2].max_intensity == 255);
}

TEST_CASE("a db.xml is recognised by its content and read in degrees and centimetres", "[calibration]") {
  const TemporaryFile marked("\xEF\xBB\xBF" + db_xml({5, 40}), ".yaml");
  const auto sensor = with_calibration_file(make_velodyne_sensor(VelodyneModel::kHdl64eS2), marked.path());
  REQUIRE(sensor.ok());
  for (const XmlRow& row : kXmlRows) {
    const LaserCalibration& laser = sensor->lasers[static_cast<std::size_t>(row.id)];
    CHECK(laser.azimuth_correction_rad == Approx(row.rot * nilio::kRadiansPerDegree));
    CHECK(laser.elevation_rad == Approx(row.vert * nilio::kRadiansPerDegree));
    CHECK(laser.distance_correction_m == Approx(row.dist * 0.01));
    CHECK(laser.near_distance_correction_x_m == Approx(row.dist_x * 0.01));
    CHECK(laser.near_distance_correction_y_m == Approx(row.dist_y * 0.01));
    CHECK(laser.vertical_offset_m == Approx(row.vert_offset * 0.01));
    CHECK(laser.horizontal_offset_m == Approx(row.horiz_offset * 0.01));
    CHECK(laser.focal_distance_m == Approx(row.focal_distance * 0.01));
    CHECK(laser.focal_slope == Approx(row.focal_slope));
    CHECK(int{laser.min_intensity} == row.min_intensity);
    CHECK(int{laser.max_intensity} == row.max_intensity);
  }
  CHECK(disabled_lasers(*sensor) == std::vector<std::uint16_t>{5, 40});
  CHECK(sensor->lasers[63].ring == 0);
  CHECK(sensor->lasers[3].ring == 63);
}

TEST_CASE("a db.xml and the YAML file of the same unit agree", "[calibration]") {
  NILIO_REQUIRE_DATA(path, "velodyne/golden/HDL64e_s2.yaml");
  const VelodyneSensor model = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  const TemporaryFile file(db_xml(), ".xml");
  const auto xml = with_calibration_file(model, file.path());
  const auto yaml = with_calibration_file(model, path.string());
  REQUIRE(xml.ok());
  REQUIRE(yaml.ok());
  for (const XmlRow& row : kXmlRows) {
    const LaserCalibration& a = xml->lasers[static_cast<std::size_t>(row.id)];
    const LaserCalibration& b = yaml->lasers[static_cast<std::size_t>(row.id)];
    // The rows are rounded to 0.0001 degree and 0.01 mm.
    CHECK(a.azimuth_correction_rad ==
          Approx(b.azimuth_correction_rad).margin(0.6e-4 * nilio::kRadiansPerDegree));
    CHECK(a.elevation_rad == Approx(b.elevation_rad).margin(0.6e-4 * nilio::kRadiansPerDegree));
    CHECK(a.distance_correction_m == Approx(b.distance_correction_m).margin(0.6e-5));
    CHECK(a.near_distance_correction_x_m == Approx(b.near_distance_correction_x_m).margin(0.6e-5));
    CHECK(a.near_distance_correction_y_m == Approx(b.near_distance_correction_y_m).margin(0.6e-5));
    CHECK(a.vertical_offset_m == Approx(b.vertical_offset_m).margin(0.6e-5));
    CHECK(a.horizontal_offset_m == Approx(b.horizontal_offset_m).margin(0.6e-5));
    CHECK(a.focal_distance_m == Approx(b.focal_distance_m));
    CHECK(a.focal_slope == Approx(b.focal_slope));
    CHECK(a.min_intensity == b.min_intensity);
    CHECK(a.max_intensity == b.max_intensity);
  }
}

TEST_CASE("errors in a db.xml name the line, the laser and the key", "[calibration]") {
  CHECK_THAT(xml_error("<id_>3<", "<vertCorrection_>2.977100<", "<vertCorrection_>flat<"),
             Contains("laser 3: vertCorrection_ is not a number"));
  CHECK_THAT(xml_error("<id_>3<", "<vertCorrection_>2.977100<", "<vertCorrection_>297.71<"),
             Contains("laser 3: vertCorrection_ is 297.71, expected -90 to 90 degrees"));
  CHECK_THAT(xml_error("<id_>3<", "<vertOffsetCorrection_>21", "<vertOffsetCorrection_>210"),
             Contains("laser 3: vertOffsetCorrection_") && Contains("centimetres"));
  CHECK_THAT(xml_error("<id_>3<", "<rotCorrection_>7.895800</rotCorrection_>", ""),
             Contains("laser 3: has no rotCorrection_"));
  CHECK_THAT(xml_error("points_", "<id_>4<", "<id_>3<"), Contains("laser 3: is there twice"));
  CHECK_THAT(xml_error("points_", "<id_>63<", "<id_>64<"), Contains("no id_ of 0 to 63"));
  CHECK_THAT(xml_error("minIntensity_", "<item>20<", "<item>-1<"),
             Contains("laser 3: minIntensity_ is not a whole number"));
  CHECK_THAT(xml_error("enabled_", "<item>1</item>", ""), Contains("enabled_ has 63 items"));
  CHECK_THAT(xml_error("distLSB_", "2.00000003e-001", "0.4"), Contains(":5: distLSB_ is 0.4 cm"));
  CHECK_THAT(xml_error("DB", "<points_>", "<points>"), Contains("not well-formed XML"));
  CHECK_THAT(xml_error("DB", "</DB>", ""), Contains("not well-formed XML"));
  const TemporaryFile other("<html/>", ".xml");
  const auto html = with_calibration_file(make_velodyne_sensor(VelodyneModel::kHdl64eS2), other.path());
  REQUIRE_FALSE(html.ok());
  CHECK_THAT(html.error().message, Contains("boost_serialization"));
}

TEST_CASE("a db.xml of another model or in other units is rejected", "[calibration]") {
  const TemporaryFile file(db_xml(), ".xml");
  const auto vlp16 = with_calibration_file(make_velodyne_sensor(VelodyneModel::kVlp16), file.path());
  REQUIRE_FALSE(vlp16.ok());
  CHECK_THAT(vlp16.error().message, Contains("laser 16: is switched on") && Contains("VLP-16 has 16"));

  std::vector<int> surplus(48);
  for (std::size_t i = 0; i < surplus.size(); ++i) surplus[i] = static_cast<int>(i) + 16;
  const TemporaryFile sixteen(db_xml(surplus), ".xml");
  CHECK(with_calibration_file(make_velodyne_sensor(VelodyneModel::kVlp16), sixteen.path()).ok());

  std::string radians = db_xml();
  for (std::size_t at = 0; (at = radians.find("<vertCorrection_>", at)) != std::string::npos; ++at) {
    const std::size_t number = at + std::string("<vertCorrection_>").size();
    const std::size_t length = radians.find('<', number) - number;
    radians.replace(number, length,
                    std::to_string(std::stod(radians.substr(number, length)) * nilio::kRadiansPerDegree));
  }
  const TemporaryFile wrong(radians, ".xml");
  const auto refused = with_calibration_file(make_velodyne_sensor(VelodyneModel::kHdl64eS2), wrong.path());
  REQUIRE_FALSE(refused.ok());
  CHECK_THAT(refused.error().message, Contains("vertCorrection_ spans only") && Contains("degrees"));
}

TEST_CASE("a written calibration reads back bit for bit", "[calibration]") {
  VelodyneSensor sensor = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  const TemporaryFile xml(db_xml({9}), ".xml");
  for (const bool from_file : {false, true}) {
    if (from_file) sensor = with_calibration_file(sensor, xml.path()).value();
    const TemporaryFile saved("", ".yaml");
    REQUIRE(write_calibration_yaml(sensor, saved.path()).ok());
    const auto loaded = with_calibration_file(make_velodyne_sensor(VelodyneModel::kHdl64eS2), saved.path());
    REQUIRE(loaded.ok());
    CHECK(loaded->lasers == sensor.lasers);
    CHECK(loaded->beam_spacing_rad == sensor.beam_spacing_rad);
  }
}

TEST_CASE("the error for a calibration that cannot be written names the file", "[calibration]") {
  const auto result =
      write_calibration_yaml(make_velodyne_sensor(VelodyneModel::kVlp16), "/nonexistent/calibration.yaml");
  REQUIRE_FALSE(result.ok());
  CHECK_THAT(result.error().message,
             Contains("/nonexistent/calibration.yaml") && Contains("cannot be written"));
}

TEST_CASE("a db.xml truncated at any byte gives an error", "[calibration]") {
  const std::string xml = db_xml();
  const VelodyneSensor model = make_velodyne_sensor(VelodyneModel::kHdl64eS2);
  std::size_t accepted = 0;
  for (std::size_t size = 0; size + 2 < xml.size(); size += 211) {
    const TemporaryFile file(xml.substr(0, size), ".xml");
    accepted += with_calibration_file(model, file.path()).ok() ? 1U : 0U;
  }
  CHECK(accepted == 0);
}
