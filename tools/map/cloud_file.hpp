#pragma once

#include "nilio/core/result.hpp"

#include "tools/common/files.hpp"
#include "tools/map/export.hpp"
#include "tools/map/las.hpp"

#include <cstdint>
#include <fstream>
#include <span>
#include <string>
#include <variant>

namespace nilio::tools::map {

/// Point cloud that is written piece by piece; the header is corrected at the end. One thread.
class CloudFile {
 public:
  /// Coordinates of LAS are relative to whole metres near `centre`.
  CloudFile(const std::string& path, ExportFormat format, const core::Vector3& centre);
  CloudFile(const CloudFile&) = delete;
  CloudFile& operator=(const CloudFile&) = delete;
  /// Removes what is not complete.
  ~CloudFile();

  void add(std::span<const CloudPoint> points);
  /// Completes the file and gives it its name. Fails if anything could not be written.
  core::Result<std::monostate> finish();
  [[nodiscard]] std::uint64_t points() const { return points_; }

 private:
  [[nodiscard]] std::string header() const;

  std::string path_;
  ExportFormat format_;
  UnfinishedFile unfinished_;
  std::ofstream file_;
  std::uint64_t points_ = 0;
  LasCoordinates las_;
};

}  // namespace nilio::tools::map
