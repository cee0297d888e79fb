#include "daemon/output/sha256.hpp"
#include "tools/bench/matrix/row.hpp"
#include "tools/simulate/scenes/scene.hpp"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <fnmatch.h>
#include <map>
#include <sstream>
#include <string_view>
#include <utility>

namespace nilio::tools::bench {

namespace {

using mangle::Faults;
using mangle::TimedFault;

// Bounds of the mean translation error, per cent. A benchmark's lowest places on real drives are below 1 %;
// with faults, or where the scene hides the motion, twice and five times that still serves a vehicle.
constexpr double kBound = 1.0;
constexpr double kFaultBound = 2.0;
constexpr double kUnobservableBound = 5.0;

constexpr const char* kKitti04 = "KITTI 04";
constexpr const char* kRaw0009 = "KITTI raw 0009";

struct NamedFaults {
  std::string name;
  Faults faults;
};

template <class Set>
NamedFaults named(const char* name, Set set) {
  NamedFaults result{name, {}};
  set(result.faults);
  return result;
}

NamedFaults lost_packets() {
  return named("20 % of packets lost", [](Faults& f) { f.loss = 0.2; });
}

/// Faults of the stream, for drives of at least 36 s.
std::vector<NamedFaults> stream_faults() {
  const auto gap = [](double seconds) { return [seconds](Faults& f) { f.gaps = {{seconds, 15.0}}; }; };
  return {named("gap 0.5 s", gap(0.5)), named("gap 1.5 s", gap(1.5)), named("gap 3 s", gap(3.0)),
          // One gap alone is a matter of luck: what is in view behind it decides.
          named("four gaps of 2 s",
                [](Faults& f) {
                  f.gaps = {{2.0, 8.0}, {2.0, 16.0}, {2.0, 24.0}, {2.0, 32.0}};
                }),
          lost_packets(),
          named("bursts of 40 packets",
                [](Faults& f) {
                  f.burst = mangle::BurstLoss{40, 1.0};
                }),
          named("duplicated and reordered", [](Faults& f) { f.duplicate = f.reorder = 0.05; }),
          named("host clock steps 1 s",
                [](Faults& f) {
                  f.clock_steps = {{1.0, 15.0}};
                }),
          named("every 2nd scan", [](Faults& f) { f.drop_scans = 2; })};
}

std::vector<NamedFaults> return_faults() {
  return {named("25 % of returns", [](Faults& f) { f.thin = 0.25; }),
          named("5 % of returns", [](Faults& f) { f.thin = 0.05; }),
          named("2000 returns", [](Faults& f) { f.points = 2000; }),
          named("300 returns", [](Faults& f) { f.points = 300; }),
          named("8 rings", [](Faults& f) { f.rings = 8; }),
          named("noise 10 cm", [](Faults& f) { f.noise_m = 0.1; }),
          named("noise 30 cm", [](Faults& f) { f.noise_m = 0.3; }),
          named("180 degrees", [](Faults& f) { f.field_of_view_deg = 180.0; }),
          named("1 % ghosts", [](Faults& f) { f.ghosts = 0.01; }),
          named("vegetation only", [](Faults& f) { f.vegetation_only = true; })};
}

/// Of the real drives, which have 5 s.
std::vector<NamedFaults> short_faults(bool reversible) {
  const auto gap = [](double seconds, double at) { return [=](Faults& f) { f.gaps = {{seconds, at}}; }; };
  std::vector<NamedFaults> faults{named("gap 0.5 s", gap(0.5, 2.0)), named("gap 1 s", gap(1.0, 2.0)),
                                  named("gap 2 s", gap(2.0, 1.5)), named("gap 4 s", gap(4.0, 0.6)),
                                  named("every 2nd scan", [](Faults& f) { f.drop_scans = 2; })};
  if (reversible) faults.push_back(named("reversed", [](Faults& f) { f.reverse = true; }));
  const std::vector<NamedFaults> more = return_faults();
  faults.insert(faults.end(), more.begin(), more.end());
  return faults;
}

class MatrixBuilder {
 public:
  void add_drive(const std::string& name, DriveKind kind, std::vector<std::string> options = {}) {
    matrix_.drives.push_back({name, kind, std::move(options), {}});
  }
  /// A row of the last drive.
  void add(const std::string& suffix, bool imu, double bound, const Faults& faults = {}) {
    const std::string& drive = matrix_.drives.back().name;
    matrix_.rows.push_back({drive + suffix, drive, imu, faults, bound});
  }
  /// Rows with and without an IMU.
  void add_both(double bound) {
    add("", true, bound);
    add(kNoImu, false, bound);
  }
  void add_faults(const std::vector<NamedFaults>& list, const std::string& suffix, bool imu) {
    for (const NamedFaults& fault : list) add(suffix + ", " + fault.name, imu, kFaultBound, fault.faults);
  }
  Matrix take() { return std::move(matrix_); }

 private:
  Matrix matrix_;
};

double bound_of(const std::string& scene) { return scene == "tunnel" ? kUnobservableBound : kBound; }

std::vector<std::string> scene_options(const std::string& scene, const std::string& sensor,
                                       const std::string& realism, const std::string& seconds) {
  return {"--scene", scene, "--sensor", sensor, "--realism", realism, "--duration", seconds};
}

std::vector<std::string> with(std::vector<std::string> options, std::initializer_list<const char*> more) {
  options.insert(options.end(), more.begin(), more.end());
  return options;
}

bool has_fault_rows(const simulate::SceneInfo& scene, const std::string& sensor) {
  return sensor == "vlp16" &&
         (scene.kind == simulate::SceneKind::kTown || scene.kind == simulate::SceneKind::kHighway);
}

void add_all_faults(MatrixBuilder& builder) {
  builder.add_faults(stream_faults(), "", true);
  builder.add_faults(stream_faults(), kNoImu, false);
  builder.add_faults(return_faults(), "", true);
}

void add_ideal_scenes(MatrixBuilder& builder, const std::string& seconds) {
  for (const std::string sensor : {"vlp16", "hdl64e"}) {
    for (const simulate::SceneInfo& scene : simulate::scene_infos()) {
      builder.add_drive(std::string(scene.name) + " " + sensor + " ideal", DriveKind::kSimulated,
                        scene_options(scene.name, sensor, "ideal", seconds));
      builder.add_both(bound_of(scene.name));
      if (has_fault_rows(scene, sensor)) add_all_faults(builder);
    }
  }
}

/// Every scene and sensor as they are, with each grade of IMU and without one.
void add_typical_scenes(MatrixBuilder& builder, const std::string& seconds) {
  for (const std::string sensor : {"vlp16", "hdl64e"}) {
    for (const simulate::SceneInfo& scene : simulate::scene_infos()) {
      for (const char* grade : {"industrial", "consumer", "automotive", "tactical"}) {
        const bool usual = std::string_view(grade) == "industrial";
        builder.add_drive(
            std::string(scene.name) + " " + sensor + " typical " + grade, DriveKind::kSimulated,
            with(scene_options(scene.name, sensor, "typical", seconds), {"--imu-grade", grade}));
        builder.add("", true, bound_of(scene.name));
        if (!usual) continue;
        builder.add(kNoImu, false, bound_of(scene.name));
        if (has_fault_rows(scene, sensor)) add_all_faults(builder);
      }
    }
  }
}

void add_variants(MatrixBuilder& builder, const std::string& seconds) {
  const auto highway = scene_options("highway", "vlp16", "ideal", seconds);
  builder.add_drive("highway vlp16 ideal, moving start", DriveKind::kSimulated,
                    with(highway, {"--moving-start"}));
  builder.add_both(kBound);
  const auto manoeuvres = scene_options("manoeuvres", "vlp16", "ideal", seconds);
  for (const char* fault : {"time_offset=50", "mounting_yaw=15", "gyro_range=60", "axes=xy-z"}) {
    builder.add_drive(std::string("manoeuvres vlp16 ideal, IMU ") + fault, DriveKind::kSimulated,
                      with(manoeuvres, {"--imu-fault", fault}));
    builder.add("", true, kFaultBound);
  }
  for (const std::string sensor : {"vlp16", "hdl64e"}) {
    const auto town = scene_options("town", sensor, "typical", seconds);
    for (const char* weather : {"wet", "rain=10", "fog=100", "dust=50"}) {
      builder.add_drive("town " + sensor + " typical, weather " + weather, DriveKind::kSimulated,
                        with(town, {"--weather", weather}));
      builder.add_both(kFaultBound);
    }
    builder.add_drive("town " + sensor + " typical, dirt on 90 degrees", DriveKind::kSimulated,
                      with(town, {"--dirt", "90"}));
    builder.add_both(kFaultBound);
    for (const char* scene : {"town", "highway"}) {
      builder.add_drive(std::string(scene) + " " + sensor + " poor", DriveKind::kSimulated,
                        scene_options(scene, sensor, "poor", seconds));
      builder.add_both(kFaultBound);
    }
  }
}

void add_real(MatrixBuilder& builder) {
  builder.add_drive(kKitti04, DriveKind::kKitti04);
  builder.add("", false, kBound);
  builder.add_faults(short_faults(true), "", false);
  builder.add_drive(kRaw0009, DriveKind::kKittiRaw0009);
  builder.add_both(kBound);
  builder.add_faults(short_faults(false), kNoImu, false);
}

}  // namespace

Matrix full_matrix() {
  MatrixBuilder builder;
  add_real(builder);
  add_ideal_scenes(builder, "40");
  add_typical_scenes(builder, "40");
  add_variants(builder, "40");
  return builder.take();
}

Matrix quick_matrix() {
  MatrixBuilder builder;
  add_real(builder);
  for (const char* realism : {"ideal", "typical"}) {
    builder.add_drive(std::string("town vlp16 ") + realism, DriveKind::kSimulated,
                      scene_options("town", "vlp16", realism, "15"));
    builder.add_both(kBound);
    builder.add_faults({lost_packets()}, kNoImu, false);
    builder.add_drive(std::string("highway vlp16 ") + realism, DriveKind::kSimulated,
                      scene_options("highway", "vlp16", realism, "15"));
    builder.add_both(kBound);
  }
  builder.add_drive("town hdl64e typical", DriveKind::kSimulated,
                    scene_options("town", "hdl64e", "typical", "8"));
  builder.add_both(kBound);
  return builder.take();
}

Matrix select_rows(Matrix matrix, const std::string& patterns) {
  const auto matches = [&](const MatrixRow& row) {
    std::istringstream list(patterns);
    for (std::string pattern; std::getline(list, pattern, '|');)
      if (fnmatch(pattern.c_str(), row.name.c_str(), 0) == 0) return true;
    return false;
  };
  std::erase_if(matrix.rows, [&](const MatrixRow& row) { return !matches(row); });
  std::erase_if(matrix.drives, [&](const DriveSpec& drive) {
    return std::none_of(matrix.rows.begin(), matrix.rows.end(),
                        [&](const MatrixRow& row) { return row.drive == drive.name; });
  });
  return matrix;
}

Matrix draw_rows(Matrix matrix, const std::string& commit, std::size_t count) {
  std::vector<std::pair<std::string, std::string>> order;
  for (const MatrixRow& row : matrix.rows)
    order.emplace_back(daemon::sha256(commit + "row" + row.name), row.name);
  std::sort(order.begin(), order.end());
  order.resize(std::min(count, order.size()));
  std::map<std::string, std::size_t> place;
  for (std::size_t i = 0; i < order.size(); ++i) place.emplace(order[i].second, i);
  std::map<std::string, std::size_t> drive_place;
  std::erase_if(matrix.rows, [&](const MatrixRow& row) { return !place.contains(row.name); });
  for (const MatrixRow& row : matrix.rows) {
    const std::size_t row_place = place.at(row.name);
    const auto [drive, added] = drive_place.emplace(row.drive, row_place);
    drive->second = std::min(drive->second, row_place);
  }
  std::erase_if(matrix.drives, [&](const DriveSpec& drive) { return !drive_place.contains(drive.name); });
  std::sort(matrix.drives.begin(), matrix.drives.end(), [&](const DriveSpec& a, const DriveSpec& b) {
    return drive_place.at(a.name) < drive_place.at(b.name);
  });
  return matrix;
}

std::uint64_t draw_seed(const std::string& commit, const std::string& drive, std::size_t run) {
  const std::string digest = daemon::sha256(commit + drive + std::to_string(run));
  return std::stoull(digest.substr(0, 16), nullptr, 16);
}

std::string find_commit(const std::string& given) {
  if (!given.empty()) return given;
  std::string text;
  if (FILE* const pipe = popen("git rev-parse HEAD 2>/dev/null", "re"); pipe != nullptr) {
    char line[128];
    if (std::fgets(line, sizeof line, pipe) != nullptr) text = line;
    pclose(pipe);
  }
  while (!text.empty() && text.back() == '\n') text.pop_back();
  return text.empty() ? NILIO_VERSION : text;
}

std::string slug(const std::string& name) {
  std::string result;
  for (const char c : name) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '.';
    if (plain) result += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    if (!plain && !result.empty() && result.back() != '_') result += '_';
  }
  return result;
}

}  // namespace nilio::tools::bench
