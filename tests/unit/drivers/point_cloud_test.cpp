#include "nilio/drivers/bag/point_cloud.hpp"

#include <array>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <iostream>
#include <map>
#include <numbers>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

namespace {

using namespace nilio;
using namespace nilio::drivers;

constexpr std::int64_t kSweepStartNs = 1'700'000'000'123'456'789;
constexpr std::size_t kBeams = 16;
constexpr std::size_t kColumns = 512;
constexpr double kSpacingDeg = 2.0;

enum class Origin { kStart, kEnd, kMiddle, kAbsolute, kNormalised };

struct Form {
  const char* name;
  std::uint8_t type;  ///< of PointField
  double unit_s;
  Origin origin;
  bool organised;
  double period_s;
};

template <class T>
void put(std::vector<std::uint8_t>& bytes, std::size_t at, double value) {
  const T number = static_cast<T>(value);
  std::memcpy(bytes.data() + at, &number, sizeof number);
}

/// One sweep of a spinning LiDAR: beam by beam in organised clouds, otherwise in firing order.
CloudCopy make_cloud(const Form& form, std::size_t index) {
  constexpr std::uint32_t kStep = 24;
  const std::int64_t start_ns =
      kSweepStartNs + static_cast<std::int64_t>(static_cast<double>(index) * form.period_s * 1e9);
  std::vector<std::uint8_t> bytes(kBeams * kColumns * kStep);
  const double span_s = form.period_s * (kColumns - 1) / kColumns;
  for (std::size_t i = 0; i < kBeams * kColumns; ++i) {
    const std::size_t beam = form.organised ? i / kColumns : i % kBeams;
    const std::size_t column = form.organised ? i % kColumns : i / kBeams;
    const double azimuth = -2.0 * std::numbers::pi * static_cast<double>(column) / kColumns;
    const double elevation = (static_cast<double>(beam) * kSpacingDeg - 15.0) * std::numbers::pi / 180.0;
    const std::size_t at = i * kStep;
    put<float>(bytes, at, 10.0 * std::cos(elevation) * std::cos(azimuth));
    put<float>(bytes, at + 4, 10.0 * std::cos(elevation) * std::sin(azimuth));
    put<float>(bytes, at + 8, 10.0 * std::sin(elevation));
    const double since_start_s = static_cast<double>(column) / kColumns * form.period_s;
    double raw = since_start_s / form.unit_s;
    if (form.origin == Origin::kEnd) raw = (since_start_s - span_s) / form.unit_s;
    if (form.origin == Origin::kMiddle) raw = (since_start_s - 0.5 * span_s) / form.unit_s;
    if (form.origin == Origin::kAbsolute)
      raw = (static_cast<double>(start_ns) * 1e-9 + since_start_s) / form.unit_s;
    if (form.origin == Origin::kNormalised) raw = static_cast<double>(column) / (kColumns - 1);
    if (form.type == 5) put<std::int32_t>(bytes, at + 12, raw);
    if (form.type == 6) put<std::uint32_t>(bytes, at + 12, raw);
    if (form.type == 7) put<float>(bytes, at + 12, raw);
    if (form.type == 8) put<double>(bytes, at + 12, raw);
    put<std::uint16_t>(bytes, at + 20, static_cast<double>(beam));
  }
  CloudView view;
  view.header.stamp = {start_ns};
  if (form.origin == Origin::kEnd) view.header.stamp.ns += std::llround(span_s * 1e9);
  if (form.origin == Origin::kMiddle) view.header.stamp.ns += std::llround(0.5 * span_s * 1e9);
  view.received = view.header.stamp +
                  core::Duration::from_seconds(form.origin == Origin::kEnd ? 0.01 : 1.1 * form.period_s);
  view.height = form.organised ? kBeams : 1;
  view.width = form.organised ? kColumns : kBeams * kColumns;
  view.fields = {{"x", 0, 7}, {"y", 4, 7}, {"z", 8, 7}, {"time", 12, form.type}};
  if (!form.organised) view.fields.push_back({"ring", 20, 4});
  view.step = kStep;
  view.points = kBeams * kColumns;
  view.data = bytes;
  return CloudCopy(view);
}

std::vector<CloudCopy> make_clouds(const Form& form) {
  std::vector<CloudCopy> clouds;
  for (std::size_t i = 0; i < CloudDecoder::kSamples; ++i) clouds.push_back(make_cloud(form, i));
  return clouds;
}

std::vector<Form> known_forms() {
  std::vector<Form> forms;
  for (const bool organised : {false, true}) {
    for (const double period_s : {0.05, 0.1, 0.2}) {
      for (const Origin origin : {Origin::kStart, Origin::kEnd, Origin::kMiddle}) {
        for (const auto& [type, unit_s] :
             {std::pair{7, 1.0}, {7, 1e-3}, {7, 1e-6}, {8, 1.0}, {8, 1e-9}, {5, 1e-6}, {5, 1e-9}})
          forms.push_back({"relative", static_cast<std::uint8_t>(type), unit_s, origin, organised, period_s});
      }
      forms.push_back({"relative", 6, 1e-9, Origin::kStart, organised, period_s});
      forms.push_back({"relative", 6, 1e-6, Origin::kStart, organised, period_s});
      for (const double unit_s : {1.0, 1e-3, 1e-6, 1e-9})
        forms.push_back({"absolute", 8, unit_s, Origin::kAbsolute, organised, period_s});
      forms.push_back({"normalised", 7, 1.0, Origin::kNormalised, organised, period_s});
    }
  }
  return forms;
}

/// Prints how often each form of times was recognised, and as what.
class FormTable {
 public:
  void add(const Form& form, bool is_right, const std::string& note) {
    constexpr std::array kTypes{"", "", "", "", "", "i32", "u32", "f32", "f64"};
    constexpr std::array kOrigins{"start", "end", "middle", "absolute", "0..1"};
    const std::size_t begin = note.find("times in ");
    const std::string text = begin == std::string::npos ? note : note.substr(begin, note.find(';') - begin);
    std::array<char, 80> key{};
    std::snprintf(key.data(), key.size(), "| %s | %-8s | %-5.0e |", kTypes[form.type],
                  kOrigins[static_cast<std::size_t>(form.origin)], form.unit_s);
    Row& row = rows_[key.data()];
    row.text = text;
    (form.organised ? row.organised : row.unorganised).add(is_right);
  }
  void print() const {
    std::cout
        << "| type | origin | unit, s | unorganised | organised | reported (sweeps of 50, 100, 200 ms) |\n";
    for (const auto& [key, row] : rows_)
      std::cout << key << ' ' << row.unorganised.text() << " | " << row.organised.text() << " | " << row.text
                << " |\n";
  }

 private:
  struct Count {
    int right = 0;
    int all = 0;
    void add(bool is_right) {
      ++all;
      right += is_right ? 1 : 0;
    }
    [[nodiscard]] std::string text() const { return std::to_string(right) + " of " + std::to_string(all); }
  };
  struct Row {
    Count unorganised;
    Count organised;
    std::string text;
  };
  std::map<std::string, Row> rows_;
};

}  // namespace

TEST_CASE("every form of point times is recognised and reported", "[point_cloud]") {
  FormTable table;
  for (const Form& form : known_forms()) {
    CAPTURE(form.name, int{form.type}, form.unit_s, static_cast<int>(form.origin), form.organised,
            form.period_s);
    const std::vector<CloudCopy> clouds = make_clouds(form);
    auto decoder = CloudDecoder::create(clouds, "/points");
    REQUIRE(decoder.ok());
    REQUIRE(decoder->notes().size() == 1);
    CAPTURE(decoder->notes().front());
    CHECK(decoder->warnings().empty());
    core::Scan scan;
    bool is_right = true;
    for (std::size_t i = 0; i < clouds.size(); ++i) {
      REQUIRE(decoder->decode(clouds[i].view, scan));
      REQUIRE(scan.points.size() == kBeams * kColumns);
      const std::int64_t start_ns =
          kSweepStartNs + static_cast<std::int64_t>(static_cast<double>(i) * form.period_s * 1e9);
      // A double resolves absolute seconds to 0.24 us; a 32-bit tick of a microsecond is one.
      is_right = is_right && std::abs(scan.start.ns - start_ns) < 2'000;
      CHECK(is_right);
      const auto span_ns = static_cast<double>((scan.end - scan.start).ns);
      CHECK(span_ns == Approx(form.period_s * 1e9 * (kColumns - 1) / kColumns)
                           .margin(form.origin == Origin::kNormalised ? 5e5 : 3e3));
    }
    CHECK(scan.beam_spacing_rad * 180.0 / std::numbers::pi == Approx(kSpacingDeg).margin(0.05));
    CHECK(scan.coverage_deg > 350.0F);
    table.add(form, is_right, decoder->notes().front());
  }
  table.print();
}

TEST_CASE("implausible times are refused with their values", "[point_cloud]") {
  // A span of 5 s or of 1 ms is no sweep in any unit; an absolute time does not fit into 32 bits.
  for (const Form& form : {Form{"too long", 7, 0.02, Origin::kStart, false, 0.1},
                           Form{"too short", 7, 90.0, Origin::kStart, false, 0.1},
                           Form{"float", 7, 1.0, Origin::kAbsolute, false, 0.1}}) {
    CAPTURE(form.name);
    const auto decoder = CloudDecoder::create(make_clouds(form), "/points");
    REQUIRE_FALSE(decoder.ok());
    std::cout << form.name << ": " << decoder.error().message << '\n';
    CHECK_THAT(decoder.error().message,
               Catch::StartsWith("/points: its times") && Catch::Contains("point_times"));
  }
}

TEST_CASE("clouds without times get them by azimuth, and say so", "[point_cloud]") {
  std::vector<CloudCopy> clouds = make_clouds({"none", 7, 1.0, Origin::kStart, false, 0.1});
  for (CloudCopy& cloud : clouds)
    std::erase_if(cloud.view.fields, [](const CloudField& field) { return field.name == "time"; });
  auto decoder = CloudDecoder::create(clouds, "/points");
  REQUIRE(decoder.ok());
  REQUIRE(decoder->warnings().size() == 1);
  CHECK_THAT(decoder->warnings().front(), Catch::Contains("azimuth"));
  core::Scan scan;
  REQUIRE(decoder->decode(clouds[1].view, scan));
  CHECK((scan.end - scan.start).seconds() == Approx(0.1).margin(0.002));
}

TEST_CASE("points that are no returns are left out", "[point_cloud]") {
  const Form form{"relative", 7, 1.0, Origin::kStart, false, 0.1};
  std::vector<CloudCopy> clouds = make_clouds(form);
  auto decoder = CloudDecoder::create(clouds, "/points");
  REQUIRE(decoder.ok());
  CloudCopy& cloud = clouds.front();
  std::fill(cloud.bytes.begin(), cloud.bytes.begin() + 12, std::uint8_t{0});
  const float nan = std::nanf("");
  std::memcpy(cloud.bytes.data() + 24, &nan, sizeof nan);
  core::Scan scan;
  REQUIRE(decoder->decode(cloud.view, scan));
  CHECK(scan.points.size() == kBeams * kColumns - 2);
}

TEST_CASE("clouds of another layout than the first do not take part in recognition", "[point_cloud]") {
  const Form form{"relative", 7, 1.0, Origin::kStart, false, 0.1};
  std::vector<CloudCopy> clouds = make_clouds(form);
  // The columns of the first cloud lie outside of these points.
  for (std::size_t i = 3; i < clouds.size(); ++i) {
    CloudView& view = clouds[i].view;
    view.step = 12;
    view.fields = {{"x", 0, 7}, {"y", 4, 7}, {"z", 8, 7}};
    clouds[i].bytes.resize(view.points * view.step);
    clouds[i].bytes.shrink_to_fit();
    view.data = clouds[i].bytes;
  }
  auto decoder = CloudDecoder::create(clouds, "/points");
  REQUIRE(decoder.ok());
  core::Scan scan;
  CHECK(decoder->decode(clouds.front().view, scan));
  CHECK_FALSE(decoder->decode(clouds.back().view, scan));
}

TEST_CASE("a cloud whose times leave those of the topic is refused", "[point_cloud]") {
  for (const Form& form : {Form{"relative", 8, 1.0, Origin::kStart, false, 0.1},
                           Form{"absolute", 8, 1.0, Origin::kAbsolute, false, 0.1}}) {
    CAPTURE(form.name);
    std::vector<CloudCopy> clouds = make_clouds(form);
    auto decoder = CloudDecoder::create(clouds, "/points");
    REQUIRE(decoder.ok());
    core::Scan scan;
    for (const double wrong : {1e30, -1e30, -5e9}) {
      for (std::size_t i = 0; i < kBeams * kColumns; ++i)
        put<double>(clouds.front().bytes, i * clouds.front().view.step + 12, wrong);
      CHECK_FALSE(decoder->decode(clouds.front().view, scan));
    }
  }
}
