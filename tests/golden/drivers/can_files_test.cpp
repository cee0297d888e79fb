// Real DBC files and a minute of a real car's bus.

#include "nilio/drivers/can/can_files.hpp"

#include "nilio/drivers/can/dbc/dbc.hpp"
#include "nilio/drivers/imu/decoder.hpp"

#include "tests/support/drivers_support.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/temporary_folder.hpp"

#include <numbers>
#include <sstream>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::drivers;
using nilio::tests::TemporaryFile;

namespace {

struct Series {
  std::vector<double> seconds;
  std::vector<double> values;
};

void unpack(const std::filesystem::path& archive, const TemporaryFile& file) {
  const std::string command = "xz -dc '" + archive.string() + "' > '" + file.path() + "'";
  REQUIRE(std::system(command.c_str()) == 0);
}

/// Column 3 of "t_s,gyro_x,gyro_y,gyro_z,...".
Series phone_gyro_z(const std::string& path) {
  Series series;
  std::istringstream text(nilio::tests::read_file(path));
  std::string line;
  std::getline(text, line);
  while (std::getline(text, line)) {
    std::array<double, 4> fields{};
    char comma = 0;
    std::istringstream row(line);
    for (double& field : fields) row >> field >> comma;
    series.seconds.push_back(fields[0]);
    series.values.push_back(fields[3]);
  }
  return series;
}

double interpolate(const Series& series, double seconds) {
  const auto next = std::lower_bound(series.seconds.begin(), series.seconds.end(), seconds);
  if (next == series.seconds.begin()) return series.values.front();
  if (next == series.seconds.end()) return series.values.back();
  const auto i = static_cast<std::size_t>(next - series.seconds.begin());
  const double share = (seconds - series.seconds[i - 1]) / (series.seconds[i] - series.seconds[i - 1]);
  return series.values[i - 1] + share * (series.values[i] - series.values[i - 1]);
}

double correlation(const std::vector<double>& a, const std::vector<double>& b) {
  const auto n = static_cast<double>(a.size());
  double mean_a = 0.0;
  double mean_b = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    mean_a += a[i] / n;
    mean_b += b[i] / n;
  }
  double ab = 0.0;
  double aa = 0.0;
  double bb = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ab += (a[i] - mean_a) * (b[i] - mean_b);
    aa += (a[i] - mean_a) * (a[i] - mean_a);
    bb += (b[i] - mean_b) * (b[i] - mean_b);
  }
  return ab / std::sqrt(aa * bb);
}

}  // namespace

TEST_CASE("real DBC files are read completely", "[can_files]") {
  NILIO_REQUIRE_DATA(folder, "can");
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (entry.path().extension() != ".dbc") continue;
    CAPTURE(entry.path());
    const auto database = load_dbc(entry.path().string());
    REQUIRE(database.ok());
    // Each BO_ is a message, except for the pseudo-message of unassigned signals.
    const std::string text = nilio::tests::read_file(entry.path());
    std::size_t messages = 0;
    for (std::size_t at = text.find("\nBO_ "); at != std::string::npos; at = text.find("\nBO_ ", at + 1))
      ++messages;
    if (text.find("\nBO_ 3221225472 ") != std::string::npos) --messages;
    CHECK(database->messages.size() == messages);
    ++files;
  }
  CHECK(files == 3);
  const auto xsens = load_dbc((folder / "xsens_mti.dbc").string());
  REQUIRE(xsens.ok());
  REQUIRE(xsens->find("Acceleration", "accZ") != nullptr);
  CHECK(xsens->find("Acceleration", "accZ")->factor == 0.00390625);
  CHECK(xsens->find("Acceleration", "accZ")->unit == "m/s\xC2\xB2");
  const auto sbg = load_dbc((folder / "sbg_ellipse.dbc").string());
  REQUIRE(sbg.ok());
  REQUIRE(sbg->find("SBG_ECAN_MSG_IMU_INFO", "TEMPERATURE") != nullptr);
  CHECK(sbg->find("SBG_ECAN_MSG_IMU_INFO", "TEMPERATURE")->unit ==
        "\xC2\xB0"
        "C");
}

TEST_CASE("a car's yaw rate is decoded from every frame and agrees with a phone's gyro", "[can_files]") {
  NILIO_REQUIRE_DATA(folder, "can");
  const TemporaryFile log("", ".log");
  const TemporaryFile phone("", ".csv");
  unpack(folder / "toyota_rav4_60s_candump.log.xz", log);
  unpack(folder / "toyota_rav4_60s_phone_imu.csv.xz", phone);
  const auto database = load_dbc((folder / "toyota_2017.dbc").string());
  REQUIRE(database.ok());
  const DbcMessage* kinematics = database->find("KINEMATICS");
  const DbcSignal* yaw_rate = database->find("KINEMATICS", "YAW_RATE");
  REQUIRE(yaw_rate != nullptr);
  auto source = open_candump(log.path(), "");
  REQUIRE(source.ok());
  Series car;
  std::size_t frames = 0;
  std::array<CanFrame, 64> slots;
  while (const std::size_t count = (*source)->read(slots, {}).count) {
    for (const CanFrame& frame : std::span(slots).first(count)) {
      if (frame.id != 0x24) continue;
      ++frames;
      const auto degrees = decode_physical(*kinematics, *yaw_rate, {frame.data.data(), frame.length});
      if (!degrees) continue;
      car.seconds.push_back(frame.stamp.seconds());
      car.values.push_back(*degrees * std::numbers::pi / 180.0);
    }
  }
  CHECK(frames == 4974);
  CHECK(car.values.size() == frames);
  const double rate = static_cast<double>(frames - 1) / (car.seconds.back() - car.seconds.front());
  CHECK(rate == Approx(82.9).margin(0.1));
  const Series gyro = phone_gyro_z(phone.path());
  REQUIRE(gyro.values.size() > 6000);
  std::vector<double> at_car;
  for (const double t : car.seconds) at_car.push_back(interpolate(gyro, t));
  CHECK(correlation(car.values, at_car) == Approx(-0.78).margin(0.01));
}

TEST_CASE("a car's three axes give samples for inspection, with their gaps", "[can_files]") {
  NILIO_REQUIRE_DATA(folder, "can");
  const TemporaryFile log("", ".log");
  unpack(folder / "toyota_rav4_60s_candump.log.xz", log);
  const auto database = load_dbc((folder / "toyota_2017.dbc").string());
  REQUIRE(database.ok());
  const ImuMapping mapping{
      .name = "toyota",
      .angular_velocity = {{{}, {}, {"KINEMATICS", "YAW_RATE", std::numbers::pi / 180.0}}},
      .linear_acceleration = {{{"KINEMATICS", "ACCEL_X"}, {"KINEMATICS", "ACCEL_Y"}, {}}}};
  CHECK_FALSE(ImuDecoder::create(mapping, *database).ok());
  auto decoder = ImuDecoder::create_partial(mapping, *database);
  REQUIRE(decoder.ok());
  auto source = open_candump(log.path(), "");
  REQUIRE(source.ok());
  std::array<CanFrame, 64> slots;
  while (const std::size_t count = (*source)->read(slots, {}).count) {
    for (const CanFrame& frame : std::span(slots).first(count)) decoder->add(frame);
  }
  const ImuDecoderStats& stats = decoder->stats();
  CHECK(stats.frames == 4974);
  CHECK(stats.samples == 4974);
  CHECK(stats.other_frames == 98'800 - 4974);
  CHECK(stats.out_of_order == 0);
  CHECK(stats.saturated == 0);
  CHECK(stats.frozen == 0);
  // The log's stamps are those of a gateway that forwards frames in batches.
  CHECK(stats.gaps == 664);
  CHECK(stats.longest_gap.milliseconds() == Approx(29.27).margin(0.01));
}

TEST_CASE("our DBC files have the signal layout of the manufacturers' files", "[can_files]") {
  NILIO_REQUIRE_DATA(folder, "can");
  for (const char* name : {"xsens_mti", "sbg_ellipse"}) {
    CAPTURE(name);
    const auto theirs = load_dbc((folder / (std::string(name) + ".dbc")).string());
    REQUIRE(theirs.ok());
    const auto ours = imu_preset(name);
    REQUIRE(ours.ok());
    std::size_t same = 0;
    for (const auto* axes : {&ours->mapping.angular_velocity, &ours->mapping.linear_acceleration}) {
      for (const ImuAxis& axis : *axes) {
        const DbcMessage* message = ours->database.find(axis.message);
        const DbcSignal* signal = ours->database.find(axis.message, axis.signal);
        for (const DbcMessage& candidate : theirs->messages) {
          if (candidate.id != message->id) continue;
          for (const DbcSignal& their : candidate.signals) {
            if (their.start_bit != signal->start_bit) continue;
            CHECK(their.length == signal->length);
            CHECK(their.little_endian == signal->little_endian);
            CHECK(their.is_signed == signal->is_signed);
            CHECK(their.factor == signal->factor);
            CHECK(their.offset == signal->offset);
            ++same;
          }
        }
      }
    }
    CHECK(same == 6);
  }
}
