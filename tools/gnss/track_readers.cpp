#include "nilio/core/units.hpp"
#include "nilio/drivers/bag/sources.hpp"
#include "nilio/drivers/capture/pcap.hpp"
#include "nilio/drivers/velodyne/clock/nmea.hpp"
#include "nilio/drivers/velodyne/clock/position_packet.hpp"
#include "nilio/drivers/velodyne/packet.hpp"

#include "tools/common/statistics.hpp"
#include "tools/common/text.hpp"
#include "tools/common/trajectory.hpp"
#include "tools/gnss/track.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

namespace nilio::tools::gnss {

namespace {

using core::Duration;
using core::Error;
using core::Result;
using core::Time;
using drivers::BagContent;

constexpr std::int64_t kDayNs = 86'400 * kNanosecondsPerSecond;
constexpr Duration kSameClock{1'000'000'000};
constexpr std::array<const char*, 3> kColumns{"stamp_s", "latitude_deg", "longitude_deg"};

/// A sentence with a position, and the time of its message.
struct Sentence {
  Time received;
  drivers::NmeaFix content;

  /// Time of the measurement by the receiver; the date of GGA sentences is that of the message.
  [[nodiscard]] std::optional<Time> measured() const {
    if (content.utc) return content.utc;
    if (!content.time_of_day) return std::nullopt;
    const std::int64_t day = received.ns / kDayNs * kDayNs;
    std::int64_t ns = day + content.time_of_day->ns;
    if (ns - received.ns > kDayNs / 2) ns -= kDayNs;
    if (received.ns - ns > kDayNs / 2) ns += kDayNs;
    return Time{ns};
  }
};

/// Sentences of one topic or capture as positions.
class SentenceTrack {
 public:
  void add(Time received, std::string_view text, Track& track) {
    const auto content = drivers::parse_nmea(text, received);
    if (!content) {
      // GSA, GSV, VTG, ... state no position.
      const std::string_view formatter = text.substr(std::min<std::size_t>(text.size(), 3), 3);
      if (formatter == "RMC" || formatter == "GGA") ++track.left_out;
      return;
    }
    if (!content->valid || !content->latitude_deg || !content->longitude_deg) {
      ++track.without_fix;
      return;
    }
    has_altitudes_ |= content->sentence == drivers::NmeaSentence::kGga;
    sentences_.push_back({received, *content});
  }

  void finish(Track& track) {
    if (has_altitudes_)
      std::erase_if(sentences_,
                    [](const Sentence& s) { return s.content.sentence == drivers::NmeaSentence::kRmc; });
    if (sentences_.empty()) return;
    const std::optional<Duration> delay = median_delay();
    const bool uses_own = delay && *delay <= kSameClock && -*delay <= kSameClock;
    track.notes.push_back(
        uses_own
            ? format("times are those of the sentences, which were received %.3f s later (median)",
                     delay->seconds())
            : std::string("times are those of reception, some tenths of a second late: the sentences' own "
                          "belong to another clock"));
    const auto states_geoid = [](const Sentence& s) { return s.content.geoid_height_m.has_value(); };
    // Some receivers have no model of the geoid and state 0.
    const auto has_geoid = [](const Sentence& s) { return s.content.geoid_height_m.value_or(0.0) != 0.0; };
    track.above_sea_level = has_altitudes_ && (!std::ranges::all_of(sentences_, states_geoid) ||
                                               std::ranges::none_of(sentences_, has_geoid));
    if (track.above_sea_level)
      track.notes.emplace_back(
          "altitudes are above mean sea level: the sentences lack the height of the geoid, or state 0");
    for (const Sentence& sentence : sentences_) {
      const drivers::NmeaFix& content = sentence.content;
      Fix fix;
      fix.stamp = uses_own ? sentence.measured().value_or(sentence.received) : sentence.received;
      fix.latitude_deg = *content.latitude_deg;
      fix.longitude_deg = *content.longitude_deg;
      fix.altitude_m = content.altitude_m;
      if (fix.altitude_m && !track.above_sea_level) *fix.altitude_m += content.geoid_height_m.value_or(0.0);
      fix.quality = quality_of(content);
      track.fixes.push_back(std::move(fix));
    }
  }

 private:
  static std::string quality_of(const drivers::NmeaFix& content) {
    constexpr std::array<const char*, 9> kNames{"",          "autonomous", "differential", "precise",  "rtk",
                                                "rtk_float", "estimated",  "manual",       "simulated"};
    const auto quality = static_cast<std::size_t>(content.quality);
    return quality < kNames.size() ? kNames[quality] : "other";
  }
  [[nodiscard]] std::optional<Duration> median_delay() const {
    std::vector<Duration> delays;
    for (const Sentence& sentence : sentences_) {
      if (const auto measured = sentence.measured()) delays.push_back(sentence.received - *measured);
    }
    if (delays.empty()) return std::nullopt;
    return median(std::move(delays));
  }

  std::vector<Sentence> sentences_;
  bool has_altitudes_ = false;
};

/// Empty unless both horizontal deviations are stated and positive.
std::optional<std::array<double, 3>> checked_deviations(const std::array<double, 3>& stated) {
  const auto is_stated = [](double deviation) { return std::isfinite(deviation) && deviation > 0.0; };
  if (!is_stated(stated[0]) || !is_stated(stated[1])) return std::nullopt;
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  return std::array{stated[0], stated[1], is_stated(stated[2]) ? stated[2] : kNone};
}

void add_fix(const drivers::BagFix& message, Track& track) {
  if (message.status < 0) {
    ++track.without_fix;
    return;
  }
  Fix fix;
  fix.stamp = message.header.stamp;
  fix.latitude_deg = message.latitude_deg;
  fix.longitude_deg = message.longitude_deg;
  if (std::isfinite(message.altitude_m)) fix.altitude_m = message.altitude_m;
  const auto& variance = message.variance_m2;
  if (message.covariance_type > 0)
    fix.deviation_m =
        checked_deviations({std::sqrt(variance[0]), std::sqrt(variance[1]), std::sqrt(variance[2])});
  fix.quality = message.status == 0 ? "fix" : message.status == 1 ? "sbas" : "gbas";
  track.fixes.push_back(std::move(fix));
}

/// The named topic, or the only one of the first content that occurs.
Result<drivers::BagTopic> choose_topic(const std::vector<std::string>& files, const std::string& named) {
  const std::string& bag = files.front();
  const auto survey = drivers::survey_bag(files);
  if (!survey) return survey.error();
  std::string list;
  for (const BagContent content : {BagContent::kFix, BagContent::kSentence}) {
    const auto topics = survey->with(content);
    for (const drivers::BagTopicSurvey* const topic : topics) {
      const bool is_meant =
          topic->topic.name == named || (named.empty() && topics.size() == 1 && list.empty());
      if (is_meant) {
        if (const std::string problem = drivers::why_undecodable(topic->topic); !problem.empty())
          return Error{bag + ": " + problem};
        return topic->topic;
      }
      list += (list.empty() ? "" : ", ") + topic->topic.name + " (" + topic->topic.type + ")";
    }
  }
  if (list.empty())
    return Error{bag +
                 ": no topic with positions of a GNSS receiver (sensor_msgs/NavSatFix, "
                 "nmea_msgs/Sentence)"};
  if (named.empty()) return Error{bag + ": several topics have positions - set --topic to one of " + list};
  return Error{bag + ": --topic: '" + named + "' has no positions; those that do: " + list};
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> cells(1);
  for (const char c : line) {
    if (c == ',')
      cells.emplace_back();
    else if (c != '\r')
      cells.back() += c;
  }
  return cells;
}

}  // namespace

Result<Track> read_bag(const std::vector<std::string>& files, const std::string& topic) {
  const auto chosen = choose_topic(files, topic);
  if (!chosen) return chosen.error();
  const std::string& name = chosen->name;
  const auto reader = drivers::open_bag(files, [&](const drivers::BagTopic& t) { return t.name == name; });
  if (!reader) return reader.error();
  Track track;
  track.name = files.front() + " " + name;
  SentenceTrack sentences;
  while (const auto message = (*reader)->next()) {
    const drivers::BagTopic& from = (*reader)->topics()[message->topic];
    if (drivers::content_of(from) == BagContent::kFix) {
      const auto fix = drivers::decode_fix(from, *message);
      fix ? add_fix(*fix, track) : static_cast<void>(++track.left_out);
    } else if (const auto sentence = drivers::decode_sentence(from, *message)) {
      sentences.add(sentence->header.stamp, sentence->sentence, track);
    } else {
      ++track.left_out;
    }
  }
  sentences.finish(track);
  for (const std::string& note : (*reader)->notes()) track.notes.push_back(note);
  return track;
}

Result<Track> read_capture(const std::string& path) {
  const auto source = drivers::open_pcap(path, {});
  if (!source) return source.error();
  Track track;
  track.name = path;
  SentenceTrack sentences;
  std::string last;
  std::vector<drivers::Packet> packets(64);
  for (;;) {
    const drivers::SourceRead read = (*source)->read(packets, {});
    if (read.state != drivers::SourceState::kData) break;
    for (std::size_t i = 0; i < read.count; ++i) {
      if (!drivers::is_position_packet(packets[i])) continue;
      const auto position =
          drivers::parse_position_packet({packets[i].data.data(), drivers::kPositionPacketSize});
      // The sensor repeats the latest sentence in every packet.
      if (!position || position->nmea().empty() || position->nmea() == last) continue;
      last = position->nmea();
      sentences.add(packets[i].stamp, last, track);
    }
  }
  sentences.finish(track);
  return track;
}

bool is_csv_track(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line)) return false;
  const std::vector<std::string> names = split(line);
  return std::ranges::all_of(kColumns,
                             [&](const char* name) { return std::ranges::find(names, name) != names.end(); });
}

Result<Track> read_csv(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  if (!std::getline(file, line))
    return Error{path + ": cannot be read or is empty - name a ROS bag, a capture or a CSV file"};
  const std::vector<std::string> names = split(line);
  std::array<std::size_t, 7> columns{};
  const std::array<const char*, 7> wanted{kColumns[0],  kColumns[1],   kColumns[2], "altitude_m",
                                          "std_east_m", "std_north_m", "std_up_m"};
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    columns[i] = static_cast<std::size_t>(std::ranges::find(names, wanted[i]) - names.begin());
    if (i < kColumns.size() && columns[i] == names.size())
      return Error{line_error(path, 1,
                              std::string("no column ") + wanted[i] +
                                  "; a track has stamp_s, latitude_deg, longitude_deg and, "
                                  "optionally, altitude_m, std_east_m, std_north_m, std_up_m")};
  }
  const auto quality = static_cast<std::size_t>(std::ranges::find(names, "quality") - names.begin());
  Track track;
  track.name = path;
  for (std::size_t number = 2; std::getline(file, line); ++number) {
    if (line.empty()) continue;
    const std::vector<std::string> cells = split(line);
    std::array<std::optional<double>, 7> values;
    for (std::size_t i = 0; i < wanted.size(); ++i) {
      if (columns[i] >= cells.size() || cells[columns[i]].empty()) continue;
      const auto value = parse_numbers(cells[columns[i]]);
      if (!value || value->size() != 1)
        return Error{line_error(path, number, std::string(wanted[i]) + " is no number")};
      values[i] = value->front();
    }
    const auto stamp = parse_stamp(columns[0] < cells.size() ? cells[columns[0]] : "");
    if (!stamp) return Error{line_error(path, number, "stamp_s is no time in seconds")};
    if (!values[1] || !values[2]) {
      ++track.without_fix;
      continue;
    }
    if (std::abs(*values[1]) > 90.0 || std::abs(*values[2]) > 180.0)
      return Error{line_error(path, number, "is no latitude and longitude in degrees")};
    Fix fix;
    fix.stamp = *stamp;
    fix.latitude_deg = *values[1];
    fix.longitude_deg = *values[2];
    fix.altitude_m = values[3];
    fix.deviation_m =
        checked_deviations({values[4].value_or(0.0), values[5].value_or(0.0), values[6].value_or(0.0)});
    if (quality < cells.size()) fix.quality = cells[quality];
    track.fixes.push_back(std::move(fix));
  }
  return track;
}

}  // namespace nilio::tools::gnss
