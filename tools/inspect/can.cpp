#include "tools/inspect/can.hpp"

#include "nilio/drivers/can/can_files.hpp"

#include "tools/common/progress.hpp"
#include "tools/common/text.hpp"

#include <algorithm>
#include <array>
#include <fstream>
#include <limits>
#include <span>
#include <tuple>
#include <utility>

namespace nilio::tools::inspect {

namespace {

using core::Error;
using core::Result;

constexpr std::uint64_t kLinesPerUpdate = 4096;
/// More than all 11-bit identifiers of two interfaces.
constexpr std::size_t kMaximumMessages = 8192;
constexpr std::size_t kMaximumInterfaces = 16;
/// A CAN FD frame of 64 bytes takes about 190 characters.
constexpr std::size_t kLongestLine = 512;
/// 2001-09-09: no recording of a Velodyne is older.
constexpr core::Time kFirstWallClock{1'000'000'000'000'000'000};
/// 2100: later stamps are damage.
constexpr core::Time kLastStamp{4'102'444'800'000'000'000};

/// Intervals before gaps are counted, and the factor over the mean that is a gap.
constexpr std::uint64_t kUsualAfter = 10;
constexpr double kGap = 2.0;
/// Source address of a J1939 identifier.
constexpr std::uint32_t kSenderByte = 0xFF;

struct Message {
  CanMessageFindings findings;
  core::Time last;
  /// Null where there is no DBC, or no such message in it.
  const drivers::DbcMessage* description = nullptr;

  void note_interval(double seconds) {
    Spread& intervals = findings.interval_s;
    if (intervals.count() >= kUsualAfter && seconds > kGap * intervals.mean()) ++findings.gaps;
    intervals.add(seconds);
  }

  void decode(const drivers::CanFrame& frame) {
    if (description == nullptr || frame.remote) return;
    for (std::size_t i = 0; i < description->signals.size(); ++i) {
      const auto value = drivers::decode_physical(*description, description->signals[i],
                                                  std::span(frame.data).first(frame.length));
      if (value) findings.signals[i].physical.add(*value);
    }
  }
};

const drivers::DbcMessage* find_description(const drivers::DbcDatabase* dbc, std::uint32_t id,
                                            bool extended) {
  if (dbc == nullptr) return nullptr;
  for (const drivers::DbcMessage& message : dbc->messages) {
    const std::uint32_t ignored = message.j1939 ? kSenderByte : 0;
    if (message.extended == extended && (message.id | ignored) == (id | ignored)) return &message;
  }
  return nullptr;
}

class CanInspector {
 public:
  CanInspector(const std::string& path, const drivers::DbcDatabase* dbc) : dbc_(dbc) {
    findings_.path = path;
  }

  /// Fails only when a built-in preset does not load.
  Result<std::monostate> add_line(std::string_view line, bool whole) {
    ++line_;
    if (line.empty() || line.front() != '(') return std::monostate{};
    const auto parsed = whole ? drivers::parse_candump_line(line) : std::nullopt;
    if (!parsed || parsed->frame.stamp > kLastStamp) {
      if (findings_.broken_lines++ == 0) findings_.first_broken_line = line_;
      return std::monostate{};
    }
    return add_frame(*parsed);
  }

  CanFindings finish() {
    for (auto& [key, message] : messages_) findings_.messages.push_back(std::move(message.findings));
    for (auto& [name, inspectors] : imus_) {
      for (ImuInspector& inspector : inspectors) {
        ImuFindings imu = inspector.finish();
        if (imu.stats.frames > 0) findings_.imus.push_back(std::move(imu));
      }
    }
    std::stable_sort(
        findings_.imus.begin(), findings_.imus.end(),
        [](const ImuFindings& a, const ImuFindings& b) { return a.stats.samples > b.stats.samples; });
    return std::move(findings_);
  }

 private:
  using MessageKey = std::tuple<std::string, bool, std::uint32_t>;

  Result<std::monostate> add_frame(const drivers::CandumpLine& line) {
    const drivers::CanFrame& frame = line.frame;
    if (findings_.frames++ == 0) findings_.first = findings_.last = frame.stamp;
    if (frame.stamp < previous_) ++findings_.out_of_order;
    previous_ = frame.stamp;
    findings_.first = std::min(findings_.first, frame.stamp);
    findings_.last = std::max(findings_.last, frame.stamp);
    findings_.error_frames += static_cast<std::uint64_t>(frame.error);
    findings_.remote_frames += static_cast<std::uint64_t>(frame.remote);
    findings_.fd_frames += static_cast<std::uint64_t>(frame.flexible_data_rate);
    // The identifier of an error frame is the kind of error.
    if (frame.error) return std::monostate{};
    if (!findings_.interfaces.contains(line.interface_name)) {
      if (findings_.interfaces.size() == kMaximumInterfaces) {
        ++findings_.further_frames;
        return std::monostate{};
      }
      const Result<std::monostate> added = add_interface(line.interface_name);
      if (!added) return added.error();
    }
    ++findings_.interfaces[line.interface_name];
    for (ImuInspector& imu : imus_[line.interface_name]) imu.add(frame);
    count_message(line);
    return std::monostate{};
  }

  Result<std::monostate> add_interface(const std::string& name) {
    for (const std::string& preset : drivers::imu_preset_names()) {
      Result<ImuInspector> imu = ImuInspector::create(preset, name);
      // A preset with fewer than six axes cannot be used for odometry.
      if (imu) imus_[name].push_back(std::move(imu).value());
    }
    return std::monostate{};
  }

  void count_message(const drivers::CandumpLine& line) {
    const drivers::CanFrame& frame = line.frame;
    const MessageKey key{line.interface_name, frame.extended, frame.id};
    auto message = messages_.find(key);
    if (message == messages_.end()) {
      if (messages_.size() == kMaximumMessages) {
        ++findings_.further_frames;
        return;
      }
      message = messages_.emplace(key, Message{}).first;
      CanMessageFindings& found = message->second.findings;
      std::tie(found.interface_name, found.extended, found.id) = key;
      found.shortest = found.longest = frame.length;
      describe(message->second);
    } else {
      message->second.note_interval((frame.stamp - message->second.last).seconds());
    }
    CanMessageFindings& found = message->second.findings;
    message->second.last = frame.stamp;
    ++found.frames;
    found.shortest = std::min(found.shortest, frame.length);
    found.longest = std::max(found.longest, frame.length);
    message->second.decode(frame);
  }

  void describe(Message& message) const {
    message.description = find_description(dbc_, message.findings.id, message.findings.extended);
    if (message.description == nullptr) return;
    message.findings.name = message.description->name;
    for (const drivers::DbcSignal& signal : message.description->signals)
      message.findings.signals.push_back({signal.name, signal.unit, {}});
  }

  const drivers::DbcDatabase* dbc_;
  CanFindings findings_;
  std::map<MessageKey, Message> messages_;
  std::map<std::string, std::vector<ImuInspector>> imus_;
  std::uint64_t line_ = 0;
  core::Time previous_{std::numeric_limits<std::int64_t>::min()};
};

}  // namespace

double CanMessageFindings::rate_hz() const { return interval_s.mean() > 0.0 ? 1.0 / interval_s.mean() : 0.0; }

const ImuFindings* CanFindings::imu() const {
  const auto found =
      std::find_if(imus.begin(), imus.end(), [](const ImuFindings& imu) { return imu.plausible(); });
  return found == imus.end() ? nullptr : &*found;
}

bool CanFindings::has_wall_clock() const { return first >= kFirstWallClock; }

Result<CanFindings> inspect_can_log(const std::string& path, const drivers::DbcDatabase* dbc) {
  std::ifstream file(path);
  if (!file) return Error{path + ": could not be opened - check the path and its permissions"};
  CanInspector inspector(path, dbc);
  std::array<char, kLongestLine> line{};
  Progress progress(path + ", lines read");
  for (std::uint64_t lines = 0; file; ++lines) {
    if (lines % kLinesPerUpdate == 0) progress.update(lines);
    file.getline(line.data(), static_cast<std::streamsize>(line.size()));
    if (file.bad() || (file.eof() && file.gcount() == 0)) break;
    const bool whole = file.eof() || !file.fail();
    if (!whole) {
      // Longer than any frame: skipped up to its end, so that memory stays bounded.
      file.clear();
      file.ignore(std::numeric_limits<std::streamsize>::max(), '\n');
    }
    const Result<std::monostate> added = inspector.add_line(std::string_view(line.data()), whole);
    if (!added) return added.error();
  }
  if (file.bad()) return Error{path + ": reading failed; check the disk"};
  return inspector.finish();
}

std::string why_unusable(const CanFindings& can) {
  const auto count = [](std::uint64_t n) { return static_cast<unsigned long long>(n); };
  if (can.frames > 0) {
    return format("%s: all of its %llu frames are error frames - check the bus's bit rate and termination",
                  can.path.c_str(), count(can.frames));
  }
  return format(
      "%s: no CAN frame in it (%llu broken lines, first line %llu); expected lines as 'candump -L' writes "
      "them: (1700000000.123456) can0 034#0000000009CF",
      can.path.c_str(), count(can.broken_lines), count(can.first_broken_line));
}

}  // namespace nilio::tools::inspect
