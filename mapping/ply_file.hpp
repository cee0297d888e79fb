#pragma once

#include "nilio/core/result.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <variant>

#include "mapping/map_folder.hpp"

namespace nilio::mapping {

/// The export of a map that grows with it: a point for each surface. The number of points in the header
/// follows each submap, so the file is whole after an abrupt end, too. One thread.
class PlyFile {
 public:
  /// Continues the file of an earlier process, as far as it holds whole submaps of the map.
  static core::Result<PlyFile> open(const std::filesystem::path& path, const MapReader& map);
  PlyFile(PlyFile&& other) noexcept;
  PlyFile& operator=(PlyFile&& other) = delete;
  PlyFile(const PlyFile&) = delete;
  PlyFile& operator=(const PlyFile&) = delete;
  ~PlyFile();

  /// Appends the submaps that the file lacks. After an error, the next call tries again.
  core::Result<std::monostate> update(const MapReader& map);

 private:
  PlyFile(std::filesystem::path path, int file_descriptor)
      : path_(std::move(path)), file_descriptor_(file_descriptor) {}
  [[nodiscard]] bool write_at(std::size_t offset, std::span<const std::uint8_t> bytes) const;

  std::filesystem::path path_;
  int file_descriptor_;
  std::size_t submaps_ = 0;
  std::uint64_t points_ = 0;
};

}  // namespace nilio::mapping
