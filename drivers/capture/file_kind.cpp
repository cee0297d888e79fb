#include "nilio/drivers/capture/file_kind.hpp"

#include "nilio/drivers/can/can_files.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <filesystem>
#include <fstream>
#include <span>
#include <system_error>

namespace nilio::drivers {

namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

constexpr std::size_t kHeadSize = 4096;

struct Packer {
  std::string_view magic;
  const char* name;
  const char* command;
};
constexpr std::array<Packer, 4> kPackers{{
    {"\x1F\x8B"sv, "gzip", "gunzip"},
    {"\xFD"
     "7zXZ"sv,
     "xz", "unxz"},
    {"\x28\xB5\x2F\xFD"sv, "zstd", "unzstd"},
    {"BZh"sv, "bzip2", "bunzip2"},
}};

const Packer* find_packer(std::string_view head) {
  const auto found = std::find_if(kPackers.begin(), kPackers.end(),
                                  [&](const Packer& packer) { return head.starts_with(packer.magic); });
  return found == kPackers.end() ? nullptr : &*found;
}

bool is_one_of(const fs::path& extension, std::span<const std::string_view> names) {
  return std::find(names.begin(), names.end(), extension.string()) != names.end();
}

/// Empty for what is no regular file: reading a pipe would take its content away.
std::string read_head(const std::string& path) {
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return {};
  std::string head(kHeadSize, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(head.data(), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
  return head;
}

bool is_capture(std::string_view head) {
  constexpr std::array kMagics{"\xA1\xB2\xC3\xD4"sv, "\xD4\xC3\xB2\xA1"sv, "\xA1\xB2\x3C\x4D"sv,
                               "\x4D\x3C\xB2\xA1"sv, "\x0A\x0D\x0D\x0A"sv};
  return std::any_of(kMagics.begin(), kMagics.end(),
                     [&](std::string_view magic) { return head.starts_with(magic); });
}

bool is_bag(std::string_view head) {
  constexpr std::array kMagics{"#ROSBAG V"sv, "SQLite format 3"sv, "\x89MCAP"sv};
  return std::any_of(kMagics.begin(), kMagics.end(),
                     [&](std::string_view magic) { return head.starts_with(magic); });
}

bool is_can_log(std::string_view head) {
  while (!head.empty()) {
    const std::size_t end = std::min(head.find('\n'), head.size());
    if (parse_candump_line(head.substr(0, end))) return true;
    head.remove_prefix(std::min(end + 1, head.size()));
  }
  return false;
}

}  // namespace

FileKind file_kind(const std::string& path) {
  if (path.ends_with(kPartialSuffix)) return FileKind::kOther;
  const std::string head = read_head(path);
  if (is_capture(head)) return FileKind::kCapture;
  if (is_bag(head)) return FileKind::kBag;
  if (is_can_log(head)) return FileKind::kCanLog;
  const fs::path name(path);
  constexpr std::array kCaptures{".pcap"sv, ".pcapng"sv, ".cap"sv};
  constexpr std::array kOthers{".candump"sv, ".log"sv, ".asc"sv, ".bag"sv, ".db3"sv, ".mcap"sv};
  if (find_packer(head) != nullptr) {
    // lidar.pcap.gz
    const fs::path inner = name.stem().extension();
    return is_one_of(inner, kCaptures) || is_one_of(inner, kOthers) ? FileKind::kCompressed
                                                                    : FileKind::kOther;
  }
  if (is_one_of(name.extension(), kCaptures)) return FileKind::kCapture;
  return name.extension() == ".candump" ? FileKind::kCanLog : FileKind::kOther;
}

std::string why_no_recording(const std::string& path) {
  constexpr const char* kPointFiles =
      "is a single point cloud without a time; write the clouds of a drive into a ROS bag as "
      "sensor_msgs/PointCloud2 "
      "with a field of times";
  struct Known {
    std::string_view magic;
    const char* text;
  };
  constexpr std::array<Known, 3> kKnown{{
      {"PK\x03\x04"sv, "is a zip archive; unpack it"},
      {"# .PCD v"sv, kPointFiles},
      {"ply\n"sv, kPointFiles},
  }};
  if (path.ends_with(kPartialSuffix))
    return "is unfinished: the program that wrote it was interrupted; record again, or rename it to use what "
           "is there";
  const std::string head = read_head(path);
  if (head.empty()) return "is empty (0 bytes); the recording was never written, record again";
  if (const Packer* const packer = find_packer(head))
    return std::string("is compressed (") + packer->name + "); unpack it with '" + packer->command + " " +
           path + "'";
  for (const Known& known : kKnown) {
    if (head.starts_with(known.magic)) return known.text;
  }
  if (path.ends_with(".bin")) return kPointFiles;
  return "is neither a capture (pcap, pcapng) nor a ROS bag (bag, db3, mcap) nor a CAN log ('candump -L': "
         "(1700000000.123456) can0 "
         "034#0000000009CF)";
}

}  // namespace nilio::drivers
