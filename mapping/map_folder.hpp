#pragma once

#include "nilio/core/result.hpp"
#include "nilio/core/time.hpp"

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "mapping/keyframe.hpp"
#include "mapping/map_correction.hpp"
#include "mapping/record_log.hpp"
#include "mapping/submap.hpp"
#include "mapping/submap_codec.hpp"

namespace nilio::mapping {

/// Entry of a submap in map.log.
struct SubmapEntry {
  std::uint32_t id = 0;
  std::uint64_t file_bytes = 0;
  std::uint32_t file_crc32c = 0;
  core::SE3 T_odom_submap;
  core::SE3 T_map_submap;  ///< after loop closure, if there was one; not in map.log
  core::Time first_stamp;
  core::Time last_stamp;
  std::uint32_t keyframes = 0;
  std::uint32_t surfaces = 0;
  Eigen::Vector3f minimum = Eigen::Vector3f::Zero();
  Eigen::Vector3f maximum = Eigen::Vector3f::Zero();
};

/// Header of a map.
struct MapHeader {
  MapId id{};
  core::Time created;
  /// Run that has written the map; a mapper that is started again in the same run continues it.
  std::string session;
};

/// A map on disk, to read: submaps/NNNNNN.sub, the list of them in map.log, and `poses`, what loop closure
/// has made of their poses. Its content is not trusted.
class MapReader {
 public:
  static core::Result<MapReader> open(const std::filesystem::path& folder);

  [[nodiscard]] const MapHeader& header() const { return header_; }
  /// In order of their ids.
  [[nodiscard]] const std::vector<SubmapEntry>& submaps() const { return submaps_; }
  /// Reads a submap and checks it against its entry. Thread-safe.
  [[nodiscard]] core::Result<Submap> load(const SubmapEntry& entry) const;
  /// Loops that loop closure has verified.
  [[nodiscard]] const std::vector<Loop>& loops() const { return loops_; }
  /// Place of the map and positions of GNSS, if it has them.
  [[nodiscard]] const std::optional<MapGnss>& gnss() const { return gnss_; }
  /// Correction of the last submap.
  [[nodiscard]] const core::SE3& T_map_odom() const { return T_map_odom_; }
  /// Id of the last submap that loop closure has corrected.
  [[nodiscard]] std::optional<std::uint32_t> last_corrected() const { return last_corrected_; }
  /// Damage that was found and left out; empty: none.
  [[nodiscard]] const std::string& warning() const { return warning_; }

 private:
  friend class MapWriter;
  void apply(const MapCorrection& correction);

  std::filesystem::path folder_;
  MapHeader header_;
  std::vector<SubmapEntry> submaps_;
  std::vector<Loop> loops_;
  std::optional<MapGnss> gnss_;
  core::SE3 T_map_odom_;
  std::optional<std::uint32_t> last_corrected_;
  std::string warning_;
  std::size_t log_bytes_ = 0;
  std::uint64_t log_records_ = 0;
};

/// Writes a map: each submap once, atomically, then its entry in map.log. Whatever happens to the process,
/// the folder is a readable map. One thread, unless stated otherwise; a second writer of the same folder is
/// refused.
class MapWriter {
 public:
  /// Continues the map of the same session, and removes files that its log does not list. Otherwise begins a
  /// new map, and removes the files of an earlier one.
  static core::Result<MapWriter> open(const std::filesystem::path& folder, const std::string& session,
                                      core::Time now);

  core::Result<std::monostate> write(const Submap& submap, core::Time now);
  /// Replaces the result of loop closure. One thread, which may be another one.
  core::Result<std::monostate> write(const MapCorrection& correction) const;

  [[nodiscard]] const MapReader& content() const { return content_; }
  [[nodiscard]] const std::filesystem::path& folder() const { return content_.folder_; }
  /// Id of the next submap to write.
  [[nodiscard]] std::uint32_t next_id() const;
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  MapWriter(MapReader content, RecordLog log) : content_(std::move(content)), log_(std::move(log)) {}

  MapReader content_;
  RecordLog log_;
  std::optional<RecordLog> lock_;
  std::uint64_t bytes_ = 0;  ///< of the submap files
};

/// Name of a submap's file in the folder.
std::filesystem::path submap_path(const std::filesystem::path& folder, std::uint32_t id);

/// Keyframes that are not in a complete submap yet, one file for each stretch in the folder `open`, so that a
/// mapper that is killed loses at most the keyframe it was working on. Points are quantised to 2 mm. One
/// thread.
class OpenKeyframes {
 public:
  explicit OpenKeyframes(std::filesystem::path map_folder) : folder_(std::move(map_folder) /= "open") {}

  /// Keyframes of the stretches from `first` on, in order. Removes the files of others.
  [[nodiscard]] std::vector<Keyframe> take(std::uint32_t first);
  core::Result<std::monostate> add(const Keyframe& keyframe, std::uint32_t stretch);
  /// Removes the stretches before `first`.
  void remove_before(std::uint32_t first);
  /// Intact keyframes in the files of all stretches; changes nothing.
  [[nodiscard]] std::size_t count() const;

 private:
  [[nodiscard]] std::filesystem::path path_of(std::uint32_t stretch) const;

  std::filesystem::path folder_;
  std::optional<std::uint32_t> stretch_;
  std::optional<RecordLog> log_;
};

}  // namespace nilio::mapping
