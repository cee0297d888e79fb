#include "niliod_run.hpp"

#include <fstream>

namespace nilio::tests {

void NiliodRun::write_drive(double seconds) const {
  const auto rounds = [seconds](double time_s) -> core::SE3 {
    const double phase = 2.0 * std::numbers::pi * time_s / seconds;
    return {Eigen::Quaterniond(Eigen::AngleAxisd(0.3 * std::sin(phase), core::Vector3::UnitZ())),
            core::Vector3(20.0 - 5.0 * std::cos(phase), 3.0 * std::sin(phase), 0.0)};
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

bool poses_go_on(const Program& niliod) {
  const char* status = "[0-9]+ poses \\(\\+[1-9]";
  return niliod.says(status, niliod.count(status) + 2);
}

}  // namespace nilio::tests
