#include "nilio/drivers/can/can_files.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tests/support/room_drive.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/support/tools/run_command.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/mangle/mangle.hpp"

#include <algorithm>
#include <fstream>
#include <set>
#include <string>
#include <vector>

#include <catch2/catch.hpp>

using namespace nilio;
using namespace nilio::tools;
using drivers::Packet;
using drivers::VelodyneDataPacket;
using mangle::Faults;

namespace {

constexpr double kSeconds = 2.0;

/// A drive of two seconds with configuration, truth and calibration beside it.
class Drive {
 public:
  Drive() {
    std::filesystem::create_directories(path());
    tests::write_room_drive(path(), tests::s_curve, kSeconds, true);
    std::ofstream(path() / "nilio.yaml") << "lidar:\n  model: VLP-16\n";
    std::ofstream(path() / "truth.tum") << "1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n";
  }
  [[nodiscard]] std::filesystem::path path() const { return folder_.path() / "drive"; }
  [[nodiscard]] std::filesystem::path out(const std::string& name) const { return folder_.path() / name; }
  [[nodiscard]] core::Result<mangle::Summary> mangled(const std::string& name, const Faults& faults) const {
    return mangle::mangle({path().string(), out(name).string(), faults});
  }

 private:
  tests::TemporaryFolder folder_;
};

std::vector<Packet> packets_of(const std::filesystem::path& folder) {
  auto source = drivers::open_pcap((folder / "lidar.pcap").string(), {});
  REQUIRE(source);
  std::vector<Packet> packets;
  std::vector<Packet> slots(64);
  for (auto read = (*source)->read(slots, {}); read.state == drivers::SourceState::kData;
       read = (*source)->read(slots, {}))
    packets.insert(packets.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  return packets;
}

std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

std::string payload(const Packet& packet) { return {packet.data.begin(), packet.data.begin() + packet.size}; }

/// Distance and place of every entry with a return.
struct Entry {
  std::size_t packet;
  std::size_t block;
  std::size_t entry;
  int azimuth;
  int distance;
};
std::vector<Entry> returns_of(const std::vector<Packet>& packets) {
  std::vector<Entry> entries;
  for (std::size_t p = 0; p < packets.size(); ++p) {
    const auto data = drivers::decode(std::span(packets[p].data).first(packets[p].size));
    REQUIRE(data);
    for (std::size_t b = 0; b < drivers::kBlocksPerPacket; ++b)
      for (std::size_t e = 0; e < drivers::kEntriesPerBlock; ++e) {
        const int distance = data->blocks[b].entries[e].distance;
        if (distance > 0) entries.push_back({p, b, e, data->blocks[b].azimuth, distance});
      }
  }
  return entries;
}

}  // namespace

TEST_CASE("a gap removes the packets of its time and no other", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.gaps = {{0.5, 1.0}};
  const auto summary = drive.mangled("gap", faults);
  REQUIRE(summary);
  const auto before = packets_of(drive.path());
  const auto after = packets_of(drive.out("gap"));
  const auto in_gap = [&](const Packet& packet) {
    const double t = (packet.stamp - before.front().stamp).seconds();
    return t >= 1.0 && t < 1.5;
  };
  const auto lost = static_cast<std::size_t>(std::count_if(before.begin(), before.end(), in_gap));
  CHECK(lost > 300);
  CHECK(after.size() == before.size() - lost);
  CHECK(summary->packets.lost_in_gaps == lost);
  CHECK(std::none_of(after.begin(), after.end(), in_gap));
  // Truth, configuration and the IMU's frames stay.
  CHECK(bytes_of(drive.out("gap") / "truth.tum") == bytes_of(drive.path() / "truth.tum"));
  CHECK(bytes_of(drive.out("gap") / "nilio.yaml") == bytes_of(drive.path() / "nilio.yaml"));
  CHECK(bytes_of(drive.out("gap") / "imu.candump.log") == bytes_of(drive.path() / "imu.log"));
}

TEST_CASE("losses have their share, repeat with their seed and differ with another", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.loss = 0.2;
  REQUIRE(drive.mangled("a", faults));
  REQUIRE(drive.mangled("b", faults));
  faults.seed = 2;
  REQUIRE(drive.mangled("c", faults));
  const auto before = static_cast<double>(packets_of(drive.path()).size());
  const auto after = static_cast<double>(packets_of(drive.out("a")).size());
  // Four standard deviations.
  CHECK(std::abs(after - 0.8 * before) < 4.0 * std::sqrt(before * 0.2 * 0.8));
  CHECK(bytes_of(drive.out("a") / "lidar.pcap") == bytes_of(drive.out("b") / "lidar.pcap"));
  CHECK(bytes_of(drive.out("a") / "lidar.pcap") != bytes_of(drive.out("c") / "lidar.pcap"));
}

TEST_CASE("bursts remove consecutive packets", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.burst = mangle::BurstLoss{40, 0.3};
  faults.seed = 3;
  const auto summary = drive.mangled("burst", faults);
  REQUIRE(summary);
  const auto before = packets_of(drive.path());
  const auto after = packets_of(drive.out("burst"));
  std::set<std::int64_t> there;
  for (const Packet& packet : after) there.insert(packet.stamp.ns);
  std::size_t lost = 0;
  std::size_t bursts = 0;
  bool was_there = true;
  for (const Packet& packet : before) {
    const bool is_there = there.contains(packet.stamp.ns);
    lost += is_there ? 0 : 1;
    bursts += was_there && !is_there ? 1 : 0;
    was_there = is_there;
  }
  CHECK(lost == summary->packets.lost_in_bursts);
  CHECK(bursts >= 2);
  // Adjacent bursts join, and the last one may end with the recording.
  CHECK(lost >= 40 * (bursts - 1));
}

TEST_CASE("duplicates repeat a packet, and reordered ones change their contents and keep their times",
          "[packets]") {
  const Drive drive;
  Faults faults;
  faults.duplicate = 0.1;
  const auto duplicated = drive.mangled("duplicate", faults);
  REQUIRE(duplicated);
  const auto before = packets_of(drive.path());
  const auto twice = packets_of(drive.out("duplicate"));
  std::size_t repeated = 0;
  for (std::size_t i = 1; i < twice.size(); ++i)
    repeated += payload(twice[i]) == payload(twice[i - 1]) ? 1 : 0;
  CHECK(repeated == duplicated->packets.duplicated);
  CHECK(twice.size() == before.size() + repeated);
  CHECK(20 * repeated > before.size());

  faults = {};
  faults.reorder = 0.1;
  const auto reordered = drive.mangled("reorder", faults);
  REQUIRE(reordered);
  const auto after = packets_of(drive.out("reorder"));
  REQUIRE(after.size() == before.size());
  std::size_t swapped = 0;
  for (std::size_t i = 0; i < after.size(); ++i) {
    CHECK(after[i].stamp == before[i].stamp);
    const bool with_next = i + 1 < after.size() && payload(after[i]) == payload(before[i + 1]);
    swapped += with_next && payload(after[i + 1]) == payload(before[i]) ? 1 : 0;
  }
  CHECK(swapped == reordered->packets.reordered);
  CHECK(20 * swapped > before.size());
}

TEST_CASE("a step of the host's clock shifts the later times of packets and CAN frames", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.clock_steps = {{-0.25, 1.0}};
  const auto summary = drive.mangled("step", faults);
  REQUIRE(summary);
  const auto before = packets_of(drive.path());
  const auto after = packets_of(drive.out("step"));
  REQUIRE(after.size() == before.size());
  for (std::size_t i = 0; i < after.size(); ++i) {
    const bool later = (before[i].stamp - before.front().stamp).seconds() >= 1.0;
    CHECK((after[i].stamp - before[i].stamp).ns == (later ? -250'000'000 : 0));
    CHECK(payload(after[i]) == payload(before[i]));
  }
  std::ifstream old_log(drive.path() / "imu.log");
  std::ifstream new_log(drive.out("step") / "imu.candump.log");
  std::string line;
  std::string changed;
  std::size_t shifted = 0;
  while (std::getline(old_log, line) && std::getline(new_log, changed)) {
    const auto a = drivers::parse_candump_line(line);
    const auto b = drivers::parse_candump_line(changed);
    REQUIRE((a && b));
    shifted += (b->frame.stamp - a->frame.stamp).ns == -250'000'000 ? 1 : 0;
    CHECK(b->frame.data == a->frame.data);
  }
  CHECK(shifted > 100);
  CHECK_FALSE(std::getline(old_log, line));
}

TEST_CASE("the truth follows a clock that is set forward and continues when it is set back", "[packets]") {
  const Drive drive;
  const core::Time begin = packets_of(drive.path()).front().stamp;
  Trajectory truth;
  for (int i = 0; i < 200; ++i) {
    truth.stamps.push_back(begin + core::Duration::from_seconds(0.01 * i));
    truth.poses.emplace_back(Eigen::Isometry3d::Identity());
  }
  REQUIRE(write_trajectory(truth, (drive.path() / "truth.tum").string()));
  Faults faults;
  faults.clock_steps = {{0.5, 0.6}, {-0.25, 1.0}};
  REQUIRE(drive.mangled("truth", faults));
  const auto before = read_trajectory((drive.path() / "truth.tum").string());
  const auto after = read_trajectory((drive.out("truth") / "truth.tum").string());
  REQUIRE((before && after));
  REQUIRE(before->poses.size() == 200);
  REQUIRE(after->poses.size() == 200);
  for (std::size_t i = 0; i < 200; ++i) {
    const double moved_s = (after->stamps[i] - before->stamps[i]).seconds();
    if (i != 60) CHECK(moved_s == Approx(i < 60 ? 0.0 : 0.5).margin(1e-6));
  }
}

TEST_CASE("every third revolution is dropped", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.drop_scans = 3;
  const auto summary = drive.mangled("drop", faults);
  REQUIRE(summary);
  // Twenty revolutions, cut at the rear, where the drive begins.
  CHECK(summary->scans == Approx(20).margin(1));
  CHECK(summary->scans_dropped == summary->scans / 3);
  const auto kept = static_cast<double>(packets_of(drive.out("drop")).size());
  // The first and the last revolution may be shorter.
  CHECK(kept == Approx(2.0 / 3.0 * static_cast<double>(packets_of(drive.path()).size())).epsilon(0.05));
}

TEST_CASE("eight of sixteen rings remain, evenly spaced, with their distances", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.rings = 8;
  REQUIRE(drive.mangled("rings", faults));
  const auto before = packets_of(drive.path());
  const auto after = returns_of(packets_of(drive.out("rings")));
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  std::set<unsigned> rings;
  for (const Entry& e : after) {
    rings.insert(sensor.lasers[sensor.single().entries[e.block][e.entry].laser].ring);
    const auto data = drivers::decode(std::span(before[e.packet].data).first(before[e.packet].size));
    CHECK(data->blocks[e.block].entries[e.entry].distance == e.distance);
  }
  CHECK(rings == std::set<unsigned>{1, 3, 5, 7, 9, 11, 13, 15});
  CHECK(2 * after.size() == returns_of(before).size());
}

TEST_CASE("the field of view ahead remains", "[packets]") {
  const Drive drive;
  Faults faults;
  faults.field_of_view_deg = 180.0;
  REQUIRE(drive.mangled("view", faults));
  const auto after = returns_of(packets_of(drive.out("view")));
  // Azimuth 0 is ahead.
  CHECK(std::all_of(after.begin(), after.end(),
                    [](const Entry& e) { return e.azimuth <= 9000 || e.azimuth >= 27000; }));
  CHECK(static_cast<double>(after.size()) ==
        Approx(0.5 * static_cast<double>(returns_of(packets_of(drive.path())).size())).epsilon(0.01));
}

TEST_CASE("a share or a number of returns remains in every revolution", "[packets]") {
  const Drive drive;
  const auto all = returns_of(packets_of(drive.path())).size();
  Faults faults;
  faults.thin = 0.25;
  const auto thinned = drive.mangled("thin", faults);
  REQUIRE(thinned);
  CHECK(thinned->returns.returns == all);
  CHECK(returns_of(packets_of(drive.out("thin"))).size() == thinned->returns.kept);
  CHECK(static_cast<double>(thinned->returns.kept) == Approx(0.25 * static_cast<double>(all)).epsilon(1e-3));

  faults = {};
  faults.points = 300;
  const auto few = drive.mangled("few", faults);
  REQUIRE(few);
  CHECK(few->returns.kept <= 300 * few->scans);
  CHECK(few->returns.kept > 300 * (few->scans - 2));
}

TEST_CASE("noise has its standard deviation, and ghosts their share", "[packets]") {
  const Drive drive;
  const auto before = returns_of(packets_of(drive.path()));
  Faults faults;
  faults.noise_m = 0.1;
  REQUIRE(drive.mangled("noise", faults));
  const auto noisy = returns_of(packets_of(drive.out("noise")));
  REQUIRE(noisy.size() == before.size());
  double square = 0.0;
  double sum = 0.0;
  for (std::size_t i = 0; i < noisy.size(); ++i) {
    const double error = 0.002 * (noisy[i].distance - before[i].distance);
    square += error * error;
    sum += error;
  }
  const auto n = static_cast<double>(noisy.size());
  CHECK(std::sqrt(square / n) == Approx(0.1).epsilon(0.01));
  CHECK(std::abs(sum / n) < 0.001);

  faults = {};
  faults.ghosts = 0.05;
  const auto summary = drive.mangled("ghosts", faults);
  REQUIRE(summary);
  const auto ghosts = returns_of(packets_of(drive.out("ghosts")));
  REQUIRE(ghosts.size() == before.size());
  std::size_t changed = 0;
  for (std::size_t i = 0; i < ghosts.size(); ++i) changed += ghosts[i].distance != before[i].distance ? 1 : 0;
  CHECK(static_cast<double>(changed) == Approx(0.05 * n).epsilon(0.05));
  // A ghost may fall on the distance that was there.
  CHECK(changed <= summary->returns.ghosts);
  CHECK(changed + 20 >= summary->returns.ghosts);
}

TEST_CASE("faults that a recording cannot have are refused with a sentence", "[packets]") {
  const Drive drive;
  const auto message = [&](const Faults& faults) {
    static int number = 0;
    const auto summary = drive.mangled("refused" + std::to_string(++number), faults);
    return summary ? std::string() : summary.error().message;
  };
  CHECK_THAT(message({}), Catch::StartsWith("no fault is given"));
  Faults faults;
  faults.gaps = {{1.0, 100.0}};
  CHECK_THAT(message(faults), Catch::Contains("no packet is in it"));
  faults = {};
  faults.reverse = true;
  CHECK_THAT(message(faults), Catch::Contains("cannot be reversed"));
  faults = {};
  faults.rings = 16;
  CHECK_THAT(message(faults), Catch::Contains("the sensor has 16"));
  faults = {};
  faults.thin = 0.5;
  faults.points = 10;
  CHECK_THAT(message(faults), Catch::Contains("give one of them"));
  faults = {};
  faults.loss = 0.5;
  REQUIRE(drive.mangled("full", faults));
  CHECK_THAT(drive.mangled("full", faults).error().message, Catch::Contains("is not an empty folder"));
}

TEST_CASE("the command line parses every fault and refuses nonsense", "[packets]") {
  const Drive drive;
  const auto run = [&](const std::string& out, std::vector<std::string> options) {
    std::vector<std::string> words{"mangle", drive.path().string(), drive.out(out).string()};
    words.insert(words.end(), options.begin(), options.end());
    return tests::capture_command(add_mangle_command, words);
  };
  const auto good =
      run("good", {"--gap", "0.1@0.5", "--gap", "0.1@1", "--burst", "5/0.5", "--thin", "0.5", "--seed", "3"});
  INFO(good.errors);
  CHECK(good.status == 0);
  CHECK_THAT(good.output, Catch::Contains("lost in gaps: "));
  CHECK_THAT(bytes_of(drive.out("good") / "mangle.json"),
             Catch::Contains("--gap 0.1@0.5 --gap 0.1@1 --burst 5/0.5 --thin 0.5 --seed 3"));
  CHECK(run("bad", {"--gap", "half a second"}).status == tests::kNotAccepted);
  CHECK(run("bad", {"--burst", "2.5/1"}).status == tests::kNotAccepted);
  CHECK(run("bad", {"--loss", "nan"}).status == tests::kNotAccepted);
  const auto none = run("bad", {});
  CHECK(none.status == 2);
  CHECK_THAT(none.errors, Catch::Contains("no fault is given"));
}
