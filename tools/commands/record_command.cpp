#include "tools/commands/command_line.hpp"
#include "tools/commands/commands.hpp"
#include "tools/common/system.hpp"
#include "tools/record/session.hpp"

#include <array>
#include <cstdio>
#include <ctime>
#include <memory>
#include <sys/statvfs.h>

#include <CLI/CLI.hpp>

namespace nilio::tools {

namespace {

constexpr core::Duration kPollPeriod{100'000'000};
constexpr double kStatusPeriodS = 5.0;
/// Silent sources are listed in the first status line and once a minute.
constexpr std::uint64_t kLinesPerSilenceReport = 12;
constexpr double kMega = 1e6;

struct RecordArguments {
  record::RecordConfig config;
  std::string folder;
  double rotate_mb = 1000.0;
  double rotate_s = 0.0;
  double duration_s = 0.0;
  double buffer_mb = 128.0;
  double receive_buffer_mb = 8.0;
};

void log_line(const std::string& line) { std::fprintf(stderr, "nilio record: %s\n", line.c_str()); }

unsigned long long printable(std::uint64_t number) { return number; }

std::string losses(const record::RecordProgress& progress) {
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "lost %llu in the kernel, %llu in the ring, %llu at the disk",
                printable(progress.kernel_dropped), printable(progress.ring_dropped),
                printable(progress.disk_lost));
  return text.data();
}

std::string free_space(const std::filesystem::path& folder) {
  struct statvfs space {};
  if (statvfs(folder.c_str(), &space) != 0) return "";
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), ", %.1f GB free",
                static_cast<double>(space.f_bavail) * static_cast<double>(space.f_frsize) * 1e-9);
  return text.data();
}

/// A line every few seconds with the current rates.
class RecordStatus {
 public:
  void show(const record::RecordSession& session, const std::filesystem::path& folder, double now_s) {
    if (now_s - shown_s_ < kStatusPeriodS) return;
    const record::RecordProgress progress = session.progress();
    const double span = now_s - shown_s_;
    std::array<char, 400> text{};
    std::snprintf(
        text.data(), text.size(),
        "%.0f s, %s: %llu packets, %llu frames, %.1f MB, %.0f packets and frames/s, %.2f MB/s; %s%s%s",
        now_s - begin_s_, drivers::record_file_name(drivers::RecordStream::kLidar, progress.part).c_str(),
        printable(progress.packets), printable(progress.frames), static_cast<double>(progress.bytes) / kMega,
        static_cast<double>(progress.received - last_.received) / span,
        static_cast<double>(progress.bytes - last_.bytes) / kMega / span, losses(progress).c_str(),
        free_space(folder).c_str(), progress.blocked ? "; DISK BLOCKED" : "");
    log_line(text.data());
    if (lines_shown_++ % kLinesPerSilenceReport == 0) {
      for (const std::string& line : session.source_lines(true)) log_line(line);
    }
    last_ = progress;
    shown_s_ = now_s;
  }

  [[nodiscard]] double elapsed_s() const { return monotonic_s() - begin_s_; }

 private:
  double begin_s_ = monotonic_s();
  double shown_s_ = begin_s_;
  record::RecordProgress last_;
  std::uint64_t lines_shown_ = 0;
};

/// 0, or 1 if no data were recorded or the disk did not take all of them.
int print_summary(const record::RecordSession& session, double seconds) {
  const record::RecordProgress progress = session.progress();
  std::printf("recorded   %llu packets, %llu frames, %.3f MB in %.1f s\n", printable(progress.packets),
              printable(progress.frames), static_cast<double>(progress.bytes) / kMega, seconds);
  std::printf("lost       %llu by the kernel, %llu by full rings, %llu by the disk\n",
              printable(progress.kernel_dropped), printable(progress.ring_dropped),
              printable(progress.disk_lost));
  std::printf("files      %llu written, %llu old ones deleted\n", printable(progress.files),
              printable(progress.deleted));
  for (const std::string& line : session.source_lines(false)) std::printf("source     %s\n", line.c_str());
  if (progress.packets + progress.frames > 0) return progress.disk_lost > 0 ? 1 : 0;
  log_line("no data were recorded - the lines above list the packets of each source");
  return 1;
}

int run_record(RecordArguments& arguments) {
  record::RecordConfig& config = arguments.config;
  config.folder = arguments.folder;
  config.limits.rotate_bytes = static_cast<std::uint64_t>(arguments.rotate_mb * kMega);
  config.limits.rotate_after = core::Duration::from_seconds(arguments.rotate_s);
  config.ring_bytes = static_cast<std::size_t>(arguments.buffer_mb * kMega);
  config.receive_buffer_bytes = static_cast<int>(arguments.receive_buffer_mb * 1024.0 * 1024.0);
  StopSignals signals;
  auto session = record::RecordSession::open(config, log_line);
  if (!session) {
    log_line(session.error().message);
    return 1;
  }
  (*session)->start();
  log_line("recording to " + config.folder.string() + free_space(config.folder) + "; end with Ctrl-C");
  RecordStatus status;
  while (!signals.wait(kPollPeriod)) {
    if (arguments.duration_s > 0.0 && status.elapsed_s() >= arguments.duration_s) break;
    if ((*session)->progress().all_sources_failed) break;
    status.show(**session, config.folder, monotonic_s());
  }
  (*session)->stop();
  return print_summary(**session, status.elapsed_s());
}

void add_source_options(CLI::App& command, RecordArguments& a) {
  command.add_option("--port", a.config.data_port, "UDP port of the data packets; 0 = none")
      ->capture_default_str();
  command.add_option("--position-port", a.config.position_port, "UDP port of the position packets; 0 = none")
      ->capture_default_str();
  command.add_option("--bind", a.config.bind_address, "own IPv4 address to receive on; 0.0.0.0 = all")
      ->capture_default_str();
  command.add_option("--multicast-group", a.config.multicast_group,
                     "multicast group to join (default: none)");
  command.add_option("--multicast-interface", a.config.multicast_interface,
                     "address or name of the interface to join on (default: by the routing table)");
  command.add_option("--sender", a.config.sender_address,
                     "record only packets of this IPv4 address (default: of all)");
  command
      .add_option("--can", a.config.can_interfaces,
                  "record this CAN interface, such as can0; may be repeated (default: none)")
      ->take_all()
      ->expected(1);
}

void add_file_options(CLI::App& command, RecordArguments& a) {
  command
      .add_option("--rotate-mb", a.rotate_mb,
                  "begin the next part before one grows beyond this, MB = 10^6 bytes")
      ->check(number_between(0.01, 1e9))
      ->capture_default_str();
  command.add_option("--rotate-s", a.rotate_s, "begin the next part after this many seconds; 0 = never")
      ->check(number_between(0.0, 1e9))
      ->capture_default_str();
  command
      .add_option("--keep", a.config.limits.keep,
                  "keep only the newest N parts in the folder, including those of earlier recordings, and "
                  "delete older ones; 0 = keep all")
      ->capture_default_str();
  command.add_option("--duration", a.duration_s, "end after this many seconds; 0 = at Ctrl-C or SIGTERM")
      ->check(number_between(0.0, 1e9))
      ->capture_default_str();
}

void add_resource_options(CLI::App& command, RecordArguments& a) {
  command
      .add_option("--buffer-mb", a.buffer_mb,
                  "memory in which data packets wait for the disk, MB; a VLS-128 in dual mode fills 24 MB/s")
      ->check(number_between(1.0, 100000.0))
      ->capture_default_str();
  command
      .add_option("--receive-buffer-mb", a.receive_buffer_mb,
                  "receive buffer of each socket, MiB; more than net.core.rmem_max needs CAP_NET_ADMIN")
      ->check(number_between(0.01, 1000.0))
      ->capture_default_str();
  command
      .add_option("--priority", a.config.priority,
                  "SCHED_FIFO priority of the receive threads; 0 = normal scheduling")
      ->check(CLI::Range(0, 99))
      ->capture_default_str();
}

}  // namespace

void add_record_command(CLI::App& app, int& status) {
  auto arguments = std::make_shared<RecordArguments>();
  CLI::App* command = app.add_subcommand("record", "record LiDAR packets and CAN frames to files");
  command->footer(
      "Writes lidar_0001.pcap (UDP packets with nanosecond stamps, sender and ports; the destination "
      "address is written as broadcast) and can_0001.log (as 'candump -L') to OUTPUT_FOLDER, in parts "
      "numbered after those in the folder: no file is overwritten. 'niliod --replay OUTPUT_FOLDER' and "
      "'nilio play OUTPUT_FOLDER' take all parts as one recording, so give each drive a folder.\n"
      "Data survive 'kill -9' half a second after they were received, and a loss of power after 1.5 s. When "
      "the disk is full, data that do not fit are dropped and counted, and recording continues when there "
      "is space.\n"
      "Beside a running niliod, which has the ports, copies of its packets are recorded with the same time "
      "stamps; this needs CAP_NET_RAW.");
  command->add_option("OUTPUT_FOLDER", arguments->folder, "folder for the recording, created if missing")
      ->required();
  add_source_options(*command, *arguments);
  add_file_options(*command, *arguments);
  add_resource_options(*command, *arguments);
  command->callback([arguments, &status] { status = run_record(*arguments); });
}

}  // namespace nilio::tools
