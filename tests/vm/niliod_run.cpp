#include "niliod_run.hpp"

#include <fstream>
#include <regex>
#include <sstream>

namespace nilio::tests {

namespace {

constexpr const char* kStatus = "[0-9]+ poses \\(\\+[1-9]";

}  // namespace

void NiliodRun::write_drive(double seconds) const {
  // The same speeds whatever the duration.
  const double size = seconds / 12.0;
  const auto rounds = [=](double time_s) -> core::SE3 {
    const double phase = 2.0 * std::numbers::pi * time_s / seconds;
    // Three bends a round, sharp enough that a gyro shows its worth in them.
    const double yaw = 0.3 * size * std::sin(3.0 * phase);
    return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, core::Vector3::UnitZ())),
            core::Vector3(20.0 - 5.0 * size * std::cos(phase), 3.0 * size * std::sin(phase), 0.0)};
  };
  write_room_drive(folder_.path(), rounds, seconds, true);
}

std::unique_ptr<Program> NiliodRun::start_niliod(const std::vector<std::string>& settings) const {
  std::vector<std::string> all{"lidar.model=VLP-16",      "lidar.bind_address=127.0.0.1",
                               "publisher.enabled=false", "realtime.lock_memory=false",
                               "output.map=false",        "odometry.registration_points=1000"};
  all.insert(all.end(), settings.begin(), settings.end());
  std::vector<std::string> words{NILIO_BIN_DIR "/niliod", "--output", folder_.path() / "run"};
  for (const std::string& setting : all) words.insert(words.end(), {"--set", setting});
  return std::make_unique<Program>(words, folder_.path() / "niliod.log");
}

std::unique_ptr<Program> NiliodRun::start_playing(const std::string& can_interface) const {
  return std::make_unique<Program>(
      std::vector<std::string>{NILIO_BIN_DIR "/nilio", "play", folder_.path(), "--to", "127.0.0.1", "--can",
                               can_interface, "--restamp", "--loop", "0"},
      folder_.path() / "play.log");
}

nlohmann::json NiliodRun::summary() const {
  return nlohmann::json::parse(std::ifstream(folder_.path() / "run" / "latency.json"));
}

bool poses_go_on(const Program& niliod) { return niliod.says(kStatus, niliod.count(kStatus) + 2); }

bool imu_is_used(const Program& niliod) {
  const std::regex status(kStatus);
  return eventually([&] {
    std::istringstream text(niliod.output());
    bool used = false;
    bool silent = false;
    int good = 0;
    for (std::string line; std::getline(text, line);) {
      const auto has = [&line](const char* words) { return line.find(words) != std::string::npos; };
      used = has("IMU: used") || (used && !has("IMU: not used"));
      silent = has("IMU silent") || (silent && !has("IMU frames again"));
      if (!used || silent) good = 0;
      if (std::regex_search(line, status)) ++good;
    }
    return good > 4;
  });
}

}  // namespace nilio::tests
