#include "daemon/output/sha256.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/niliod_process.hpp"
#include "tests/support/paths.hpp"
#include "tests/support/room_drive.hpp"
#include "tests/support/two_lidars.hpp"
#include "tests/support/udp_support.hpp"

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <sys/types.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <nlohmann/json.hpp>

using namespace nilio;
using tests::s_curve;
using tests::TemporaryFolder;
using tests::write_room_drive;

namespace {

namespace fs = std::filesystem;
using Finished = tests::FinishedProcess;
using Niliod = tests::NiliodProcess;
using tests::count_lines;
using tests::kNoPublisher;
using tests::own_domain;
using tests::read_file;

Finished run_niliod(const TemporaryFolder& folder, const std::vector<std::string>& arguments) {
  return Niliod(folder, arguments).wait();
}

void write_file(const fs::path& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

}  // namespace

TEST_CASE("a publisher killed during a drive is restarted at once, and the trajectory has every pose",
          "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 6.0, true);
  Niliod niliod(folder, {"--replay", folder.path().string(), "--speed", "real", "--output",
                         (folder.path() / "run").string(), "--set", own_domain(), "--set",
                         "publisher.interfaces=[\"127.0.0.1\"]"});
  const std::string pid = niliod.await("nilio-publisher started, pid ([0-9]+)");
  REQUIRE_FALSE(pid.empty());
  std::this_thread::sleep_for(std::chrono::seconds(2));
  REQUIRE(kill(static_cast<pid_t>(std::stol(pid)), SIGKILL) == 0);
  CHECK(niliod.await("killed by signal 9[^\\n]*next start ([^\\n]*)") == "now");
  CHECK_FALSE(niliod.await("started again as process ([0-9]+)").empty());
  const Finished finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == 0);
  const auto report = nlohmann::json::parse(read_file(folder.path() / "run" / "latency.json"));
  CHECK(report["counters"]["publisher_restarts"] == 1);
  CHECK(report["counters"]["publisher_dropped"] == 0);
  CHECK(report["counters"]["poses"] == report["counters"]["scans"]);
  CHECK(count_lines(folder.path() / "run" / "trajectory.tum") ==
        report["counters"]["scans"].get<std::size_t>());
  CHECK(report["counters"]["scans"].get<std::size_t>() >= 59);
}

TEST_CASE("a replay whose publisher cannot start is complete, with one error and status 3", "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.0, false);
  const fs::path alone = folder.path() / "bin";
  fs::create_directory(alone);
  for (const char* const program : {"niliod", "nilio-mapper"})
    fs::copy_file(fs::path(nilio::tests::program_folder()) / program, alone / program);
  const std::string command = (alone / "niliod").string() + " --replay " + folder.path().string() +
                              " --output " + (folder.path() / "run").string() + " > " +
                              (folder.path() / "log").string() + " 2>&1";
  std::string wanted = "nilio-publisher: No such file or directory";
  SECTION("no such program") {}
  SECTION("it ends with an error") {
    write_file(alone / "nilio-publisher", "#!/bin/sh\nexit 1\n");
    fs::permissions(alone / "nilio-publisher", fs::perms::owner_all);
    wanted = "ended with status 1";
  }
  const int status = std::system(
      (command.substr(0, command.find(" > ")) + " --speed real" + command.substr(command.find(" > ")))
          .c_str());
  CHECK(WEXITSTATUS(status) == 3);
  const std::string log = read_file(folder.path() / "log");
  INFO(log);
  std::size_t errors = 0;
  for (std::size_t at = 0; (at = log.find(" error: ", at)) != std::string::npos; ++at) ++errors;
  CHECK(errors == 1);
  CHECK(log.find(wanted) != std::string::npos);
  CHECK(log.find("niliod: nothing was published over DDS: ") != std::string::npos);
  CHECK(count_lines(folder.path() / "run" / "trajectory.tum") >= 9);
  CHECK(nlohmann::json::parse(read_file(folder.path() / "run" / "result.json"))["exit_status"] == 3);
}

TEST_CASE("result.json has versions, configuration, inputs, states and the digest of the trajectory",
          "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.5, true);
  const auto replay = [&](const std::string& run, const std::string& key) {
    const Finished finished = run_niliod(folder, {"--replay", folder.text(), "--output", folder.file(run),
                                                  "--set", kNoPublisher, "--set", key});
    INFO(finished.output);
    CHECK(finished.status == 0);
    CHECK_FALSE(fs::exists(folder.path() / run / "result.json.new"));
    return nlohmann::json::parse(read_file(folder.path() / run / "result.json"));
  };
  const auto first = replay("first", "odometry.threads=1");
  CHECK(first["exit_status"] == 0);
  CHECK(first["problem"] == "");
  CHECK_FALSE(first["versions"]["nilio"].get<std::string>().empty());
  CHECK(first["configuration_hash"].get<std::string>().size() == 16);
  REQUIRE(first["inputs"].size() == 2);
  for (const auto& input : first["inputs"]) {
    const fs::path path = input["path"].get<std::string>();
    CHECK(input["bytes"] == fs::file_size(path));
    CHECK(input["sha256"] == daemon::sha256(read_file(path)));
  }
  CHECK(first["scans"] == first["poses"]);
  CHECK(first["trajectory_sha256"] == daemon::sha256(read_file(folder.path() / "first" / "trajectory.tum")));
  CHECK(first["cpu_s"].get<double>() > 0.0);
  // Another configuration, the same bits.
  const auto second = replay("second", "odometry.threads=2");
  CHECK(second["configuration_hash"] != first["configuration_hash"]);
  CHECK(second["trajectory_sha256"] == first["trajectory_sha256"]);
}

TEST_CASE("every IMU sample of a paced replay becomes a pose, and the latencies of all stages are written",
          "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 4.0, true);
  Niliod niliod(folder, {"--replay", folder.path().string(), "--speed", "real", "--output",
                         (folder.path() / "run").string(), "--set", own_domain(), "--set",
                         "publisher.interfaces=[\"127.0.0.1\"]"});
  const Finished finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == 0);
  const auto report = nlohmann::json::parse(read_file(folder.path() / "run" / "latency.json"));
  const auto samples = report["counters"]["publisher_samples"].get<std::uint64_t>();
  CHECK(samples > 700);
  CHECK(report["counters"]["publisher_samples_dropped"] == 0);
  CHECK(report["beams"].size() == 16);
  CHECK_THAT(finished.output, Catch::Matchers::Contains("LiDAR: 16 beams corrected by"));
  std::smatch match;
  REQUIRE(std::regex_search(finished.output, match, std::regex("IMU rate: ([0-9]+) poses, 0 writes failed")));
  const std::uint64_t poses = std::stoull(match[1].str());
  // No deadline before the pose of the first scan, which may be late on a busy computer.
  CHECK(poses > samples / 2);
  CHECK(poses < samples);
  for (const char* stage :
       {"receive_to_pop", "assemble", "queue", "filter", "coarse", "fine", "deliver", "map", "end_to_end"}) {
    INFO(stage);
    const std::string text = read_file(folder.path() / "run" / "latency" / (std::string(stage) + ".hgrm"));
    CHECK(text.find("       Value     Percentile TotalCount 1/(1-Percentile)") == 0);
    const auto expected = report["stages"][stage]["count"].get<std::uint64_t>();
    CHECK(std::regex_search(text, match, std::regex("Total count    = +([0-9]+)\\]")));
    CHECK(std::stoull(match[1].str()) == expected);
  }
}

TEST_CASE("SIGTERM ends a paced replay in order with its outputs written, no result, and status 1",
          "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 6.0, false);
  Niliod niliod(folder, {"--replay", folder.path().string(), "--speed", "real", "--output",
                         (folder.path() / "run").string(), "--set", kNoPublisher});
  REQUIRE_FALSE(niliod.await("(initialising -> tracking)").empty());
  kill(niliod.pid(), SIGTERM);
  const Finished finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == 1);
  CHECK(finished.output.find("stopped by a signal before the end of the recording") != std::string::npos);
  CHECK_FALSE(fs::exists(folder.path() / "run" / "result.json"));
  CHECK(fs::exists(folder.path() / "run" / "latency.json"));
  CHECK(count_lines(folder.path() / "run" / "trajectory.tum") < 40);
}

TEST_CASE("unusable inputs end with one message that states problem, place and remedy", "[process]") {
  const TemporaryFolder folder;
  const std::string path = folder.path().string();
  const auto expect = [&](const std::vector<std::string>& arguments, const std::vector<std::string>& words,
                          int status = 1) {
    const Finished finished = run_niliod(folder, arguments);
    INFO(finished.output);
    CHECK(finished.status == status);
    CHECK(finished.output.find("niliod: ") != std::string::npos);
    for (const std::string& word : words) CHECK(finished.output.find(word) != std::string::npos);
  };
  SECTION("no such path") { expect({"--replay", path + "/nothing"}, {"/nothing", "does not exist"}); }
  SECTION("an empty folder") { expect({"--replay", path}, {"nothing to replay", ".pcap"}); }
  SECTION("an empty capture") {
    write_file(folder.path() / "empty.pcap", "");
    expect({"--replay", path + "/empty.pcap"}, {"empty.pcap", "empty"});
  }
  SECTION("a file that is no capture") {
    write_file(folder.path() / "text.pcap", "this is some text and no capture at all, though long enough");
    expect({"--replay", path + "/text.pcap"}, {"text.pcap"});
  }
  SECTION("a capture of another port") {
    write_room_drive(folder.path(), s_curve, 0.3, false);
    expect({"--replay", path, "--set", "lidar.port=2369"}, {"2369", "2368"});
  }
  SECTION("a model that the packets are not of") {
    write_room_drive(folder.path(), s_curve, 0.3, false);
    expect({"--replay", path, "--set", "lidar.model=HDL-64E-S2"}, {"HDL-64E-S2", "VLP-16"});
  }
  SECTION("a second LiDAR that would take the packets of the first") {
    write_room_drive(folder.path(), s_curve, 0.3, false);
    expect({"--replay", path, "--set", "lidar2.enabled=true"},
           {"lidar and lidar2", "sender_address", "port"});
  }
  SECTION("an unknown key") {
    write_room_drive(folder.path(), s_curve, 0.3, false);
    write_file(folder.path() / "mine.yaml", "odometry:\n  thread: 2\n");
    expect({"--replay", path, "--config", path + "/mine.yaml"},
           {"mine.yaml:2", "odometry.thread", "odometry.threads"}, 2);
  }
  SECTION("a DBC signal that is not there") {
    write_room_drive(folder.path(), s_curve, 0.3, true);
    write_file(folder.path() / "mine.dbc",
               "VERSION \"\"\nBU_: A\nBO_ 50 RateOfTurn: 6 A\n SG_ gyrX : 7|16@0- (0.001953125,0) [0|0] "
               "\"rad/s\" A\n");
    std::string yaml = "imu:\n  dbc: " + path + "/mine.dbc\n";
    for (const char* axis : {"x", "y", "z"}) {
      yaml += std::string("  angular_velocity_") + axis + ": {message: RateOfTurn, signal: gyrY}\n";
      yaml += std::string("  linear_acceleration_") + axis + ": {message: RateOfTurn, signal: gyrX}\n";
    }
    write_file(folder.path() / "mine.yaml", yaml);
    expect({"--replay", path, "--config", path + "/mine.yaml"}, {"mine.dbc", "gyrY", "gyrX"});
  }
  SECTION("a log without an IMU") {
    write_room_drive(folder.path(), s_curve, 0.3, false);
    write_file(folder.path() / "imu.log", "(1767268800.000000) can0 123#0011223344556677\n");
    expect({"--replay", path}, {"imu.log", "nilio inspect " + path + " --write-config"});
  }
  SECTION("only a packed capture") {
    write_file(folder.path() / "lidar.pcap.gz", "\x1F\x8B....");
    expect({"--replay", path}, {"gunzip " + path + "/lidar.pcap.gz"});
  }
  SECTION("an output folder that cannot be made") {
    write_room_drive(folder.path(), s_curve, 0.3, false);
    write_file(folder.path() / "file", "");
    expect({"--replay", path, "--set", kNoPublisher, "--output", path + "/file/run"},
           {"/file/run", "--output"});
  }
}

TEST_CASE("wrong usage ends with status 2 and one message", "[process]") {
  const TemporaryFolder folder;
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases{
      {{"--bogus"}, "--bogus"},
      {{"--replay", "x", "--speed", "fast"}, "--speed"},
      {{"--config", "x", "--as-live"}, "--replay"},
      {{"--replay", "x", "--as-live", "--decisions", "y"}, "choose one"},
      {{"--replay", "x", "--force"}, "--output"},
      {{"--replay", "x", "--decisions", folder.file("d"), "--output", folder.text(), "--force"},
       "choose another --output"}};
  for (const auto& [arguments, word] : cases) {
    const Finished finished = run_niliod(folder, arguments);
    INFO(finished.output);
    CHECK(finished.status == 2);
    CHECK(finished.output.find(word) != std::string::npos);
  }
  CHECK(run_niliod(folder, {"--help"}).status == 0);
}

TEST_CASE("a configuration is checked and printed with its origins without a run", "[process]") {
  const TemporaryFolder folder;
  const std::string file = folder.write("vehicle.yaml", "lidar:\n  min_range_m: 3\n");
  SECTION("without errors") {
    const Finished checked = run_niliod(folder, {"--check-config", "--config", file});
    CHECK(checked.status == 0);
    CHECK(checked.output.find("niliod: configuration: " + file + "; hash ") == 0);
    CHECK(checked.output.find("; no errors\n") != std::string::npos);
  }
  SECTION("with a wrong value in the environment") {
    Niliod niliod(folder, {"--check-config", "--config", file}, {{"NILIO_LIDAR_PORT", "0"}});
    const Finished checked = niliod.wait();
    CHECK(checked.status == 2);
    CHECK(checked.output == "niliod: NILIO_LIDAR_PORT: lidar.port is 0, allowed is 1 to 65535\n");
  }
  SECTION("with a file that is not there") {
    const Finished checked = run_niliod(
        folder, {"--check-config", "--config", file, "--set", "lidar.calibration=/nonexistent.xml"});
    CHECK(checked.status == 2);
    CHECK(checked.output.find("/nonexistent.xml") != std::string::npos);
  }
  SECTION("printed") {
    Niliod niliod(folder, {"--print-config", "--config", file, "--set", "log.level=warn"},
                  {{"NILIO_PUBLISHER_DOMAIN", "7"}, {"NILIO_PUBLISHER_DOMIAN", "8"}});
    const Finished printed = niliod.wait();
    CHECK(printed.status == 0);
    for (const std::string& line :
         {"  min_range_m: 3  # " + file + ":2", std::string("  domain: 7  # NILIO_PUBLISHER_DOMAIN"),
          std::string("  level: \"warn\"  # --set"), std::string("  port: 2368  # default"),
          std::string("niliod: NILIO_PUBLISHER_DOMIAN: is no key")})
      CHECK(printed.output.find(line) != std::string::npos);
  }
}

TEST_CASE("the log begins with the files that were read and the hash of the configuration", "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 0.5, false);
  write_file(folder.path() / "nilio.yaml", "lidar:\n  min_range_m: 1\n");
  const Finished finished = run_niliod(folder, {"--replay", folder.text(), "--set", kNoPublisher});
  INFO(finished.output);
  const std::string first = finished.output.substr(0, finished.output.find('\n'));
  CHECK(first.find("configuration: " + folder.file("nilio.yaml") + "; --set publisher.enabled; hash ") !=
        std::string::npos);
}

TEST_CASE("without a configuration niliod listens on the ports of a Velodyne", "[process]") {
  const TemporaryFolder folder;
  Niliod niliod(folder, {});
  const std::string answer = niliod.await("(:2368|in use)");
  kill(niliod.pid(), SIGTERM);
  const Finished finished = niliod.wait();
  INFO(finished.output);
  CHECK_FALSE(answer.empty());
  // Another program may have the port on this computer.
  CHECK(finished.status == (answer == "in use" ? 1 : 0));
}

TEST_CASE("the help text is at most 100 columns wide and explains the exit status", "[process]") {
  const TemporaryFolder folder;
  std::istringstream help(run_niliod(folder, {"--help"}).output);
  bool explains = false;
  for (std::string line; std::getline(help, line);) {
    CAPTURE(line);
    CHECK(line.size() <= 100);
    explains = explains || line.find("Exit status:") != std::string::npos;
  }
  CHECK(explains);
}

TEST_CASE("a second run does not overwrite the output of the first unless told to", "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 1.0, false);
  const fs::path run = folder.path() / "run";
  std::vector<std::string> arguments{"--replay",   folder.text(), "--output",
                                     run.string(), "--set",       kNoPublisher};
  CHECK(run_niliod(folder, arguments).status == 0);
  write_file(run / "decisions.jsonl", "of the first run");
  const std::string first = read_file(run / "trajectory.tum");
  const Finished refused = run_niliod(folder, arguments);
  INFO(refused.output);
  CHECK(refused.status == 1);
  CHECK(refused.output.find("holds the files of an earlier run") != std::string::npos);
  CHECK(read_file(run / "trajectory.tum") == first);
  arguments.emplace_back("--force");
  CHECK(run_niliod(folder, arguments).status == 0);
  CHECK(read_file(run / "trajectory.tum") == first);
  CHECK_FALSE(fs::exists(run / "decisions.jsonl"));
}

TEST_CASE("a replay that loses tracking ends with status 3 and the number of lost poses", "[process]") {
  const TemporaryFolder folder;
  // Again and again, so that it does not depend on how soon the place is recognised.
  const auto teleported = [](double t) {
    if (t < 2.5 || static_cast<int>(t / 0.5) % 2 == 0) return s_curve(t);
    core::SE3 pose = s_curve(t - 2.5);
    pose.translation += core::Vector3(-12.0, 6.0, 0.0);
    pose.rotation = Eigen::AngleAxisd(2.0, core::Vector3::UnitZ()) * pose.rotation;
    return pose;
  };
  write_room_drive(folder.path(), teleported, 5.0, false);
  const Finished finished =
      run_niliod(folder, {"--replay", folder.text(), "--output", folder.file("run"), "--set", kNoPublisher});
  INFO(finished.output);
  CHECK(finished.status == 3);
  const auto counters = nlohmann::json::parse(read_file(folder.path() / "run" / "latency.json"))["counters"];
  const std::string expected = "tracking was lost at " + std::to_string(counters["poses_lost"].get<int>()) +
                               " of " + std::to_string(counters["poses"].get<int>()) + " poses";
  CHECK(finished.output.find(expected) != std::string::npos);
}

TEST_CASE("a DBC file with a bad token is used, and the skipped signal is named", "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 2.0, true);
  std::string dbc = read_file(nilio::tests::source_folder() + "/config/dbc/xsens_mti.dbc");
  dbc += "BO_ 99 Other: 8 X\n SG_ broken : 0|eight@1+ (1,0) [0|0] \"\" X\n";
  write_file(folder.path() / "mine.dbc", dbc);
  std::string yaml = "imu:\n  dbc: mine.dbc\n";
  for (const char* axis : {"x", "y", "z"}) {
    const std::string upper(1, static_cast<char>(axis[0] - 'a' + 'A'));
    yaml += std::string("  angular_velocity_") + axis + ": {message: RateOfTurn, signal: gyr" + upper + "}\n";
    yaml += std::string("  linear_acceleration_") + axis + ": {message: Acceleration, signal: acc" + upper +
            "}\n";
  }
  write_file(folder.path() / "nilio.yaml", yaml);
  const Finished finished =
      run_niliod(folder, {"--replay", folder.text(), "--output", folder.file("run"), "--set", kNoPublisher});
  INFO(finished.output);
  CHECK(finished.status == 0);
  CHECK(std::regex_search(finished.output, std::regex("mine.dbc:[0-9]+: [^\\n]*'eight'[^\\n]*skipped")));
  const auto report = nlohmann::json::parse(read_file(folder.path() / "run" / "latency.json"));
  CHECK(report["counters"]["scans_with_imu"].get<int>() > 10);
}

TEST_CASE("damaged inputs are used up to the damage, which is counted and logged", "[process]") {
  const TemporaryFolder folder;
  write_room_drive(folder.path(), s_curve, 3.0, true);
  const std::string path = folder.path().string();
  SECTION("a capture cut off in mid-record") {
    const fs::path capture = folder.path() / "lidar.pcap";
    fs::resize_file(capture, fs::file_size(capture) * 2 / 3 + 7);
    const Finished finished =
        run_niliod(folder, {"--replay", path, "--output", path + "/run", "--set", kNoPublisher});
    INFO(finished.output);
    CHECK(finished.status == 0);
    CHECK(finished.output.find("lidar.pcap") != std::string::npos);
    CHECK(finished.output.find("middle of a packet") != std::string::npos);
    CHECK(count_lines(folder.path() / "run" / "trajectory.tum") >= 18);
  }
  SECTION("a CAN log with broken lines") {
    const std::string log = read_file(folder.path() / "imu.log");
    write_file(folder.path() / "imu.log",
               "(1767268800.000000) can0 03Z#00\n(not a time) can0 032#00\n" + log + "(17672688");
    const Finished finished =
        run_niliod(folder, {"--replay", path, "--output", path + "/run", "--set", kNoPublisher});
    INFO(finished.output);
    CHECK(finished.status == 0);
    CHECK(finished.output.find("imu.log") != std::string::npos);
    CHECK(std::regex_search(finished.output, std::regex("imu.log[^\\n]*3 ")));
    const auto report = nlohmann::json::parse(read_file(folder.path() / "run" / "latency.json"));
    CHECK(report["counters"]["scans_with_imu"].get<int>() >= 12);
  }
}

TEST_CASE("two LiDARs in one recording have separate counters, and mixed ones are detected", "[process]") {
  const TemporaryFolder folder;
  tests::write_two_lidar_drive(folder.path(), s_curve, 1.5, 1.5);
  const std::string path = folder.path().string();
  SECTION("distinguished by sender") {
    const std::vector<std::string> arguments = {
        "--replay", path,
        "--output", path + "/run",
        "--set",    kNoPublisher,
        "--set",    "lidar.sender_address=192.168.1.201",
        "--set",    "lidar2.enabled=true",
        "--set",    "lidar2.sender_address=192.168.1.202",
    };
    const Finished finished = run_niliod(folder, arguments);
    INFO(finished.output);
    CHECK(finished.status == 0);
    CHECK(finished.output.find("lidar2: VLP-16: return mode single") != std::string::npos);
    CHECK(finished.output.find("points merged") != std::string::npos);
    CHECK(finished.output.find("are mixed") == std::string::npos);
    const auto report = nlohmann::json::parse(read_file(folder.path() / "run" / "latency.json"));
    REQUIRE(report["lidars"].size() == 2);
    CHECK(report["lidars"][0]["section"] == "lidar");
    CHECK(report["lidars"][0]["packets"] == report["counters"]["packets"]);
    CHECK(report["lidars"][1]["model"] == "VLP-16");
    CHECK(report["lidars"][1]["points_merged"].get<int>() > 300'000);
    CHECK(report["lidars"][1]["packets_lost"] == 0);
    CHECK(report["lidars"][1]["revolutions_per_minute"].get<double>() == Approx(600.0).margin(2.0));
  }
  SECTION("taken for one") {
    const Finished finished = run_niliod(folder, {"--replay", path, "--set", kNoPublisher});
    INFO(finished.output);
    CHECK(finished.output.find("packets from 192.168.1.202 are counted and not decoded; the sensor is "
                               "192.168.1.201") != std::string::npos);
  }
}

TEST_CASE("a live niliod waits for a sensor and warns of one of another model than configured", "[process]") {
  const TemporaryFolder folder;
  const std::uint16_t port = tests::free_port();
  Niliod niliod(folder, {"--set", kNoPublisher, "--set", "realtime.policy=other", "--set",
                         "lidar.bind_address=127.0.0.1", "--set", "lidar.port=" + std::to_string(port),
                         "--set", "lidar.position_port=0", "--set", "lidar.model=HDL-32E"});
  CHECK_FALSE(niliod.await("(no scan for [0-9]+ s: [^\\n]*nothing arrives)").empty());
  const drivers::VelodyneSensor sensor = drivers::make_velodyne_sensor(drivers::VelodyneModel::kVlp16);
  tests::UdpSender sender;
  for (std::int64_t i = 0; i < 64; ++i) {
    const auto bytes = drivers::encode(
        room_packet(tests::Room::with_pillars(), s_curve, sensor, i * sensor.single().packet_period_ns));
    sender.send(port, {bytes.begin(), bytes.end()});
    if (i % 16 == 15) std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  const char* const warning = "warning: (lidar.model is HDL-32E, but the packets look like those of VLP-16)";
  CHECK_FALSE(niliod.await(warning).empty());
  REQUIRE(kill(niliod.pid(), SIGTERM) == 0);
  const Finished finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.status == 0);
}

TEST_CASE("a live niliod names the port that Velodyne packets arrive at within three seconds",
          "[process][timed]") {
  const int raw = socket(AF_PACKET, SOCK_DGRAM, 0);
  if (raw < 0) {
    WARN("skipped: no CAP_NET_RAW");
    return;
  }
  close(raw);
  const TemporaryFolder folder;
  const std::vector<std::uint16_t> ports = tests::free_ports(3);
  const auto start = std::chrono::steady_clock::now();
  Niliod niliod(folder, {"--set", kNoPublisher, "--set", "realtime.policy=other", "--set",
                         "lidar.bind_address=127.0.0.1", "--set", "lidar.port=" + std::to_string(ports[0]),
                         "--set", "lidar.position_port=" + std::to_string(ports[1])});
  tests::UdpSender sender("127.0.0.9");
  const std::string wanted = "from 127.0.0.9 to 127.0.0.1:" + std::to_string(ports[2]);
  double seconds = 0.0;
  bool found = false;
  while (!found && seconds < 10.0) {
    // Position packets arrive all the while, data packets at another port.
    sender.send(ports[1], std::vector<std::uint8_t>(512));
    for (int i = 0; i < 4; ++i) sender.send(ports[2], std::vector<std::uint8_t>(1206));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    found = niliod.output().find(wanted) != std::string::npos;
  }
  CHECK(found);
  CHECK(seconds < 3.0);
  REQUIRE(kill(niliod.pid(), SIGTERM) == 0);
  const Finished finished = niliod.wait();
  INFO(finished.output);
  CHECK(finished.output.find("set the LiDAR's port to the one that the sensor sends to") !=
        std::string::npos);
}
