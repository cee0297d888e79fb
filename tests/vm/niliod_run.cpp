#include "tests/vm/niliod_run.hpp"

#include "tests/support/paths.hpp"

#include <algorithm>
#include <chrono>
#include <fstream>
#include <iterator>
#include <regex>
#include <sstream>
#include <utility>

#include <catch2/catch.hpp>

namespace nilio::tests {

namespace {

constexpr const char* kStatus = "[0-9]+ poses \\(\\+[1-9]";
/// Time after which the IMU is used again after losses.
constexpr double kRecoveryS = 5.0;

/// Counts the seconds in which an interface received clearly fewer frames than were sent: a gap of 0.2 s, or
/// a player that is too slow.
class PaceWatch {
 public:
  PaceWatch(std::string can_interface, double frames_per_second)
      : interface_(std::move(can_interface)), rate_(frames_per_second), frames_(count()) {}

  void update() {
    const auto now = Clock::now();
    const double seconds = std::chrono::duration<double>(now - before_).count();
    if (seconds < 1.0) return;
    const std::uint64_t frames = count();
    if (static_cast<double>(frames - frames_) < 0.8 * rate_ * seconds) slow_seconds_ += seconds;
    before_ = now;
    frames_ = frames;
  }
  [[nodiscard]] double slow_seconds() const { return slow_seconds_; }

 private:
  using Clock = std::chrono::steady_clock;
  [[nodiscard]] std::uint64_t count() const { return kernel_count(interface_, "rx_packets"); }

  std::string interface_;
  double rate_;
  Clock::time_point before_ = Clock::now();
  std::uint64_t frames_;
  double slow_seconds_ = 0.0;
};

int status_lines_with_imu(const std::string& log) {
  const std::regex status(kStatus);
  std::istringstream text(log);
  bool used = false;
  bool silent = false;
  bool starved = false;
  int good = 0;
  for (std::string line; std::getline(text, line);) {
    const auto has = [&line](const char* words) { return line.find(words) != std::string::npos; };
    used = has("IMU: in use") || (used && !has("IMU: rejected"));
    silent = has("IMU silent") || (silent && !has("IMU frames received again"));
    // The player of a slow guest skips frames.
    if (has("IMU: sample_loss is")) starved = has("is bad");
    if (!used || silent || starved) good = 0;
    if (std::regex_search(line, status)) ++good;
  }
  return good;
}

}  // namespace

bool holds_at_full_pace(const std::function<bool()>& condition, const NiliodRun& run,
                        const std::string& can_interface, const std::string& what,
                        const std::function<std::string()>& log) {
  PaceWatch pace(can_interface, run.can_frames_per_second());
  const bool holds = eventually([&] {
    pace.update();
    return condition();
  });
  if (holds) return true;
  const std::string lines = log();
  INFO(pace.slow_seconds() << " s too slow\n" << lines);
  // A player that waits for the processor leaves gaps that no counter of a second shows; niliod names them.
  const bool has_gaps = count_lines(lines, "IMU: sample_(gap|loss) is (warn|bad)") > 0;
  CHECK((pace.slow_seconds() >= kPatienceS / kRecoveryS || has_gaps));
  say_undecided(what);
  return false;
}

void NiliodRun::write_drive(double seconds) {
  // Speeds do not depend on the duration.
  const double size = seconds / 12.0;
  const auto rounds = [=](double time_s) -> core::SE3 {
    const double phase = 2.0 * std::numbers::pi * time_s / seconds;
    // Three bends per round, sharp enough to benefit from a gyro.
    const double yaw = 0.3 * size * std::sin(3.0 * phase);
    return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw, core::Vector3::UnitZ())),
            core::Vector3(20.0 - 5.0 * size * std::cos(phase), 3.0 * size * std::sin(phase), 0.0)};
  };
  write_room_drive(folder_.path(), rounds, seconds, true);
  std::ifstream log(folder_.path() / "imu.log");
  const auto frames = std::count(std::istreambuf_iterator<char>(log), {}, '\n');
  can_frames_per_second_ = static_cast<double>(frames) / seconds;
}

std::unique_ptr<Program> NiliodRun::start_niliod(const std::vector<std::string>& settings) const {
  std::vector<std::string> all{"lidar.model=VLP-16",      "lidar.bind_address=127.0.0.1",
                               "publisher.enabled=false", "realtime.lock_memory=false",
                               "output.map=false",        "odometry.registration_points=400"};
  all.insert(all.end(), settings.begin(), settings.end());
  std::vector<std::string> words{program_folder() + "/niliod", "--output", folder_.path() / "run", "--force"};
  for (const std::string& setting : all) words.insert(words.end(), {"--set", setting});
  return std::make_unique<Program>(words, folder_.path() / "niliod.log");
}

std::unique_ptr<Program> NiliodRun::start_playing(const std::string& can_interface) const {
  return std::make_unique<Program>(
      std::vector<std::string>{program_folder() + "/nilio", "play", folder_.path(), "--to", "127.0.0.1",
                               "--can", can_interface, "--restamp", "--loop", "0"},
      folder_.path() / "play.log");
}

nlohmann::json NiliodRun::summary() const {
  return nlohmann::json::parse(std::ifstream(folder_.path() / "run" / "latency.json"));
}

bool poses_go_on(const Program& niliod) { return niliod.has_line(kStatus, niliod.count(kStatus) + 2); }

bool imu_is_used(const Program& niliod, const NiliodRun& run, const std::string& can_interface,
                 const std::string& what) {
  return holds_at_full_pace([&] { return status_lines_with_imu(niliod.output()) > 4; }, run, can_interface,
                            what, [&] { return niliod.output(); });
}

void check_tracking(const Program& niliod, const NiliodRun& run, const std::string& can_interface) {
  holds_at_full_pace([&] { return niliod.count("tracking: [0-9]+ poses") > 0; }, run, can_interface,
                     "whether niliod tracks", [&] { return niliod.output(); });
}

}  // namespace nilio::tests
