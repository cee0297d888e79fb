#include "mapping/map_folder.hpp"

#include <algorithm>
#include <cstdio>
#include <random>
#include <system_error>
#include <utility>

#include "mapping/crc32c.hpp"

namespace nilio::mapping {

namespace {

namespace fs = std::filesystem;
using core::Error;
using core::Result;

constexpr std::uint16_t kFormatMajor = 1;
constexpr std::uint16_t kHeaderRecord = 1;
constexpr std::uint16_t kSubmapRecord = 2;
constexpr std::uint16_t kKeyframeRecord = 3;
constexpr std::size_t kMaxSessionBytes = 256;
constexpr const char* kLogName = "map.log";
constexpr const char* kPosesName = "poses";
constexpr const char* kSubmapFolder = "submaps";
constexpr const char* kOpenFolder = "open";

std::string numbered(std::uint32_t number, const char* extension) {
  std::array<char, 32> name{};
  std::snprintf(name.data(), name.size(), "%06u.%s", number, extension);
  return name.data();
}

MapId random_id() {
  std::random_device random;
  MapId id{};
  for (std::uint8_t& byte : id) byte = static_cast<std::uint8_t>(random());
  return id;
}

Bytes encode(const MapHeader& header) {
  ByteWriter out;
  out.put(kFormatMajor);
  out.put_bytes(header.id);
  out.put(header.created.ns);
  out.put(static_cast<std::uint16_t>(header.session.size()));
  out.put_bytes({reinterpret_cast<const std::uint8_t*>(header.session.data()), header.session.size()});
  return out.take();
}

std::optional<MapHeader> decode_header(std::span<const std::uint8_t> payload) {
  ByteReader in(payload);
  if (in.get<std::uint16_t>() != kFormatMajor) return std::nullopt;
  MapHeader header;
  const auto id = in.get_bytes(header.id.size());
  if (in.failed()) return std::nullopt;
  std::copy(id.begin(), id.end(), header.id.begin());
  header.created.ns = in.get<std::int64_t>();
  const auto session = in.get_bytes(in.get<std::uint16_t>());
  if (in.failed()) return std::nullopt;
  header.session.assign(session.begin(), session.end());
  return header;
}

Bytes encode(const SubmapEntry& entry) {
  ByteWriter out;
  out.put(entry.id);
  out.put(entry.file_bytes);
  out.put(entry.file_crc32c);
  put_pose(entry.T_odom_submap, out);
  out.put(entry.first_stamp.ns);
  out.put(entry.last_stamp.ns);
  out.put(entry.keyframes);
  out.put(entry.surfaces);
  for (const Eigen::Vector3f* corner : {&entry.minimum, &entry.maximum}) {
    for (int i = 0; i < 3; ++i) out.put((*corner)[i]);
  }
  return out.take();
}

std::optional<SubmapEntry> decode_entry(std::span<const std::uint8_t> payload) {
  ByteReader in(payload);
  SubmapEntry entry;
  entry.id = in.get<std::uint32_t>();
  entry.file_bytes = in.get<std::uint64_t>();
  entry.file_crc32c = in.get<std::uint32_t>();
  entry.T_odom_submap = entry.T_map_submap = get_pose(in);
  entry.first_stamp.ns = in.get<std::int64_t>();
  entry.last_stamp.ns = in.get<std::int64_t>();
  entry.keyframes = in.get<std::uint32_t>();
  entry.surfaces = in.get<std::uint32_t>();
  for (Eigen::Vector3f* corner : {&entry.minimum, &entry.maximum}) {
    for (int i = 0; i < 3; ++i) (*corner)[i] = in.get<float>();
  }
  const bool is_possible = !in.failed() && is_valid_pose(entry.T_odom_submap) && entry.minimum.allFinite() &&
                           entry.maximum.allFinite();
  return is_possible ? std::optional(entry) : std::nullopt;
}

/// Removes the files that a map consists of, except those that `keep` accepts; other files stay.
template <class Keep>
void remove_map_files(const fs::path& folder, const Keep& keep) {
  std::error_code error;
  for (const char* const part : {"", kSubmapFolder, kOpenFolder}) {
    for (const auto& file : fs::directory_iterator(folder / part, error)) {
      const std::string name = file.path().filename().string();
      const bool is_ours =
          *part == '\0' ? name.starts_with(kPosesName + std::string(".tmp."))
                        : name.ends_with(".sub") || name.ends_with(".kf") || name.find(".tmp.") != name.npos;
      std::error_code ignored;
      if (is_ours && !keep(file.path())) fs::remove(file.path(), ignored);
    }
  }
}

constexpr float kPointStepMetres = 0.002F;

Bytes encode(const Keyframe& keyframe) {
  ByteWriter out;
  out.put(keyframe.stamp.ns);
  put_pose(keyframe.T_odom_base, out);
  for (int i = 0; i < 36; ++i) out.put(keyframe.covariance(i / 6, i % 6));
  out.put(static_cast<std::uint32_t>(keyframe.points.size()));
  for (const MapPoint& point : keyframe.points) {
    for (int i = 0; i < 3; ++i)
      out.put(static_cast<std::int16_t>(
          std::clamp(std::lround(point.position[i] / kPointStepMetres), -32768L, 32767L)));
    out.put(static_cast<std::uint8_t>(std::clamp(std::lround(point.intensity), 0L, 255L)));
  }
  return out.take();
}

std::optional<Keyframe> decode_keyframe(std::span<const std::uint8_t> payload) {
  ByteReader in(payload);
  Keyframe keyframe;
  keyframe.stamp.ns = in.get<std::int64_t>();
  keyframe.T_odom_base = get_pose(in);
  for (int i = 0; i < 36; ++i) keyframe.covariance(i / 6, i % 6) = in.get<double>();
  const auto count = in.get<std::uint32_t>();
  if (in.failed() || count != in.left() / 7 || !is_valid_pose(keyframe.T_odom_base)) return std::nullopt;
  keyframe.points.resize(count);
  for (MapPoint& point : keyframe.points) {
    for (int i = 0; i < 3; ++i)
      point.position[i] = kPointStepMetres * static_cast<float>(in.get<std::int16_t>());
    point.intensity = in.get<std::uint8_t>();
  }
  return keyframe;
}

}  // namespace

fs::path submap_path(const fs::path& folder, std::uint32_t id) {
  return folder / kSubmapFolder / numbered(id, "sub");
}

Result<MapReader> MapReader::open(const fs::path& folder) {
  const fs::path path = folder / kLogName;
  const auto log = read_log(path);
  if (!log) return Error{folder.string() + ": not a map of nilio: " + log.error().message};
  const std::vector<LogRecord>& records = log->records;
  const auto header = records.empty() || records.front().type != kHeaderRecord
                          ? std::nullopt
                          : decode_header(records.front().payload);
  if (!header)
    return Error{path.string() +
                 ": not the log of a map, damaged at its begin, or of a newer format - use a newer nilio"};
  MapReader map;
  map.folder_ = folder;
  map.header_ = *header;
  map.log_bytes_ = log->valid_bytes;
  map.log_records_ = records.size();
  for (std::size_t i = 1; i < records.size(); ++i) {
    if (records[i].type != kSubmapRecord) continue;
    const auto entry = decode_entry(records[i].payload);
    const bool is_next = entry && (map.submaps_.empty() || entry->id > map.submaps_.back().id);
    if (is_next)
      map.submaps_.push_back(*entry);
    else
      map.warning_ = path.string() + ": an impossible entry was left out";
  }
  if (log->valid_bytes != log->bytes.size())
    map.warning_ = path.string() + ": " + std::to_string(log->bytes.size() - log->valid_bytes) +
                   " damaged bytes at the end were left out";
  const fs::path poses = folder / kPosesName;
  std::error_code error;
  if (!fs::exists(poses, error)) return map;
  const auto bytes = read_bytes(poses);
  const auto correction = bytes ? decode_correction(*bytes, map.header_.id, poses.string())
                                : Result<MapCorrection>(bytes.error());
  if (correction)
    map.apply(*correction);
  else
    map.warning_ = correction.error().message;
  return map;
}

/// Later submaps follow the last corrected one as odometry has it.
void MapReader::apply(const MapCorrection& correction) {
  auto corrected = correction.poses.begin();
  for (SubmapEntry& entry : submaps_) {
    while (corrected != correction.poses.end() && corrected->first < entry.id) ++corrected;
    if (corrected != correction.poses.end() && corrected->first == entry.id)
      T_map_odom_ = corrected->second * entry.T_odom_submap.inverse();
    entry.T_map_submap = T_map_odom_ * entry.T_odom_submap;
  }
  loops_ = correction.loops;
  gnss_ = correction.gnss;
  if (!correction.poses.empty()) last_corrected_ = correction.poses.back().first;
}

Result<Submap> MapReader::load(const SubmapEntry& entry) const {
  const fs::path path = submap_path(folder_, entry.id);
  auto bytes = read_bytes(path);
  if (!bytes) return bytes.error();
  if (bytes->size() != entry.file_bytes || crc32c(*bytes) != entry.file_crc32c)
    return Error{path.string() + ": not the file that " + kLogName +
                 " lists (size or checksum differ) - restore it from a copy"};
  auto decoded = decode_submap(*bytes, path.string());
  if (!decoded) return decoded.error();
  if (decoded->map != header_.id || decoded->submap.id != entry.id ||
      decoded->submap.surfaces.size() != entry.surfaces)
    return Error{path.string() + ": belongs to another map or place - restore it from a copy"};
  return std::move(decoded->submap);
}

std::uint32_t MapWriter::next_id() const {
  return content_.submaps_.empty() ? 0 : content_.submaps_.back().id + 1;
}

Result<MapWriter> MapWriter::open(const fs::path& folder, const std::string& session, core::Time now) {
  std::error_code error;
  fs::create_directories(folder / kSubmapFolder, error);
  if (!error) fs::create_directories(folder / kOpenFolder, error);
  if (error)
    return Error{folder.string() + ": cannot be made (" + error.message() + ") - choose another folder"};
  auto existing = MapReader::open(folder);
  const bool continues = existing && existing->header_.session == session;
  MapReader content;
  if (continues) content = std::move(existing).value();
  // Locked before anything changes.
  auto lock = RecordLog::open(folder / "lock");
  if (!lock) return lock.error();
  if (!lock->lock())
    return Error{folder.string() + ": another process writes this map - choose another folder"};
  auto log = RecordLog::open(folder / kLogName, content.log_bytes_, content.log_records_);
  if (!log) return log.error();
  if (!continues) {
    remove_map_files(folder, [](const fs::path&) { return false; });
    fs::remove(folder / kPosesName, error);
    content.folder_ = folder;
    content.header_ = {random_id(), now, session.substr(0, kMaxSessionBytes)};
    if (auto written = log->append(kHeaderRecord, encode(content.header_), true); !written)
      return written.error();
  }
  MapWriter writer(std::move(content), std::move(log).value());
  writer.lock_.emplace(std::move(lock).value());
  std::vector<fs::path> listed;
  for (const SubmapEntry& entry : writer.content_.submaps_) {
    listed.push_back(submap_path(folder, entry.id));
    writer.bytes_ += entry.file_bytes;
  }
  remove_map_files(folder, [&](const fs::path& path) {
    return path.extension() == ".kf" || std::find(listed.begin(), listed.end(), path) != listed.end();
  });
  return writer;
}

Result<std::monostate> MapWriter::write(const Submap& submap, core::Time now) {
  const Bytes bytes = encode_submap(submap, content_.header_.id, now);
  if (auto written = replace_file(submap_path(content_.folder_, submap.id), bytes); !written) return written;
  SubmapEntry entry;
  entry.id = submap.id;
  entry.file_bytes = bytes.size();
  entry.file_crc32c = crc32c(bytes);
  entry.T_odom_submap = entry.T_map_submap = submap.T_odom_submap;
  if (!submap.keyframes.empty()) {
    entry.first_stamp = submap.keyframes.front().stamp;
    entry.last_stamp = submap.keyframes.back().stamp;
  }
  entry.keyframes = static_cast<std::uint32_t>(submap.keyframes.size());
  entry.surfaces = static_cast<std::uint32_t>(submap.surfaces.size());
  entry.minimum = submap.minimum;
  entry.maximum = submap.maximum;
  if (auto written = log_.append(kSubmapRecord, encode(entry), true); !written) return written;
  content_.submaps_.push_back(entry);
  bytes_ += bytes.size();
  return std::monostate{};
}

Result<std::monostate> MapWriter::write(const MapCorrection& correction) const {
  return replace_file(content_.folder_ / kPosesName, encode_correction(correction, content_.header_.id));
}

fs::path OpenKeyframes::path_of(std::uint32_t stretch) const { return folder_ / numbered(stretch, "kf"); }

std::vector<Keyframe> OpenKeyframes::take(std::uint32_t first) {
  std::vector<std::pair<std::uint32_t, fs::path>> files;
  std::error_code error;
  for (const auto& file : fs::directory_iterator(folder_, error)) {
    unsigned number = 0;
    const std::string name = file.path().filename().string();
    const bool is_listed =
        std::sscanf(name.c_str(), "%6u.kf", &number) == 1 && name == numbered(number, "kf");
    if (is_listed && number >= first)
      files.emplace_back(number, file.path());
    else
      fs::remove(file.path(), error);
  }
  std::sort(files.begin(), files.end());
  std::vector<Keyframe> keyframes;
  for (const auto& [number, path] : files) {
    const auto content = read_log(path);
    if (!content) continue;
    for (const LogRecord& record : content->records) {
      auto keyframe = record.type == kKeyframeRecord ? decode_keyframe(record.payload) : std::nullopt;
      if (keyframe) keyframes.push_back(std::move(*keyframe));
    }
  }
  return keyframes;
}

Result<std::monostate> OpenKeyframes::add(const Keyframe& keyframe, std::uint32_t stretch) {
  if (!log_ || stretch_ != stretch) {
    // A file of an earlier process is continued.
    const auto content = read_log(path_of(stretch));
    auto log = content ? RecordLog::open(path_of(stretch), content->valid_bytes, content->records.size())
                       : RecordLog::open(path_of(stretch));
    if (!log) return log.error();
    log_.emplace(std::move(log).value());
    stretch_ = stretch;
  }
  return log_->append(kKeyframeRecord, encode(keyframe), false);
}

void OpenKeyframes::remove_before(std::uint32_t first) {
  std::error_code error;
  for (const auto& file : fs::directory_iterator(folder_, error)) {
    unsigned number = 0;
    std::error_code ignored;
    if (std::sscanf(file.path().filename().c_str(), "%6u.kf", &number) == 1 && number < first)
      fs::remove(file.path(), ignored);
  }
}

std::size_t OpenKeyframes::count() const {
  std::size_t keyframes = 0;
  std::error_code error;
  for (const auto& file : fs::directory_iterator(folder_, error)) {
    if (file.path().extension() != ".kf") continue;
    if (const auto content = read_log(file.path())) keyframes += content->records.size();
  }
  return keyframes;
}

}  // namespace nilio::mapping
