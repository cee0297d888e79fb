#include "tools/inspect/recording.hpp"

#include "nilio/drivers/can/can_files.hpp"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <set>
#include <string_view>

namespace nilio::tools::inspect {

namespace {

namespace fs = std::filesystem;
using namespace std::string_view_literals;

constexpr std::size_t kHeadSize = 4096;

enum class FileKind : std::uint8_t { kCapture, kCanLog, kOther };

std::string read_head(const fs::path& path) {
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

bool is_can_log(std::string_view head) {
  while (!head.empty()) {
    const std::size_t end = std::min(head.find('\n'), head.size());
    if (drivers::parse_candump_line(head.substr(0, end))) return true;
    head.remove_prefix(std::min(end + 1, head.size()));
  }
  return false;
}

/// Extensions count only for unrecognised content, so that damaged files get the reader's message.
FileKind kind_of(const fs::path& path, std::string_view head) {
  static const std::set<std::string> kCaptures = {".pcap", ".pcapng", ".cap"};
  static const std::set<std::string> kCanLogs = {".candump"};
  if (is_capture(head)) return FileKind::kCapture;
  if (is_can_log(head)) return FileKind::kCanLog;
  if (kCaptures.contains(path.extension().string())) return FileKind::kCapture;
  if (kCanLogs.contains(path.extension().string())) return FileKind::kCanLog;
  return FileKind::kOther;
}

/// Reason and remedy for a file that is neither capture nor CAN log.
std::string why_other(std::string_view head) {
  struct Known {
    std::string_view magic;
    const char* text;
  };
  constexpr std::array<Known, 8> kKnown{{
      {"\x1F\x8B"sv, "is compressed (gzip); unpack it with 'gunzip'"},
      {"\xFD"
       "7zXZ"sv,
       "is compressed (xz); unpack it with 'unxz'"},
      {"\x28\xB5\x2F\xFD"sv, "is compressed (zstd); unpack it with 'unzstd'"},
      {"BZh"sv, "is compressed (bzip2); unpack it with 'bunzip2'"},
      {"PK\x03\x04"sv, "is a zip archive; unpack it"},
      {"#ROSBAG"sv, "is a ROS bag; this command reads captures and CAN logs"},
      {"SQLite format 3"sv,
       "is an SQLite file, perhaps a ROS 2 bag; this command reads captures and CAN logs"},
      {"\x89MCAP"sv, "is an MCAP file; this command reads captures and CAN logs"},
  }};
  if (head.empty()) return "is empty (0 bytes); the recording was never written, record again";
  for (const Known& known : kKnown) {
    if (head.starts_with(known.magic)) return known.text;
  }
  return "is neither a capture (pcap, pcapng) nor a CAN log ('candump -L': (1700000000.123456) can0 "
         "034#0000000009CF)";
}

void inspect_file(const fs::path& path, bool named_by_user, const drivers::DbcDatabase* dbc,
                  RecordingFindings& findings) {
  const std::string head = read_head(path);
  const FileKind kind = kind_of(path, head);
  if (kind == FileKind::kOther) {
    if (named_by_user) findings.problems.push_back(path.string() + ": " + why_other(head));
    return;
  }
  if (head.empty()) {
    findings.problems.push_back(path.string() + ": " + why_other(head));
    return;
  }
  if (kind == FileKind::kCapture) {
    core::Result<CaptureFindings> capture = inspect_capture(path.string());
    if (!capture) {
      findings.problems.push_back(capture.error().message);
      return;
    }
    if (!capture->usable()) findings.problems.push_back(why_unusable(*capture));
    findings.captures.push_back(std::move(capture).value());
    return;
  }
  core::Result<CanFindings> can = inspect_can_log(path.string(), dbc);
  if (!can) {
    findings.problems.push_back(can.error().message);
    return;
  }
  if (!can->usable()) findings.problems.push_back(why_unusable(*can));
  findings.can_logs.push_back(std::move(can).value());
}

void inspect_folder(const fs::path& folder, const drivers::DbcDatabase* dbc, RecordingFindings& findings) {
  std::error_code code;
  std::set<fs::path> entries;
  for (fs::directory_iterator entry(folder, code), end; !code && entry != end; entry.increment(code))
    if (entry->is_regular_file(code)) entries.insert(entry->path());
  const std::size_t before = findings.captures.size() + findings.can_logs.size() + findings.problems.size();
  for (const fs::path& entry : entries) inspect_file(entry, false, dbc, findings);
  if (code) {
    findings.problems.push_back(folder.string() + ": cannot be read (" + code.message() + ")");
  } else if (before == findings.captures.size() + findings.can_logs.size() + findings.problems.size()) {
    findings.problems.push_back(folder.string() +
                                ": no capture (pcap, pcapng) or CAN log (candump -L) in this folder");
  }
}

}  // namespace

TimeRelation relate(const CanFindings& can, const CaptureFindings& capture) {
  TimeRelation result;
  result.start_offset_s = (can.first - capture.first).seconds();
  const double overlap_s = (std::min(can.last, capture.last) - std::max(can.first, capture.first)).seconds();
  result.overlap_s = std::max(overlap_s, 0.0);
  result.apart_s = std::max(-overlap_s, 0.0);
  return result;
}

bool RecordingFindings::usable() const {
  return std::any_of(captures.begin(), captures.end(), [](const CaptureFindings& c) { return c.usable(); }) ||
         std::any_of(can_logs.begin(), can_logs.end(), [](const CanFindings& c) { return c.usable(); });
}

RecordingFindings inspect_recording(const std::vector<std::string>& paths, const drivers::DbcDatabase* dbc) {
  RecordingFindings findings;
  for (const std::string& path : paths) {
    std::error_code code;
    const fs::file_status status = fs::status(path, code);
    if (!fs::exists(status)) {
      findings.problems.push_back(path + ": no such file or folder - check the path");
    } else if (fs::is_directory(status)) {
      inspect_folder(path, dbc, findings);
    } else {
      inspect_file(path, true, dbc, findings);
    }
  }
  return findings;
}

}  // namespace nilio::tools::inspect
