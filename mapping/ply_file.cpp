#include "mapping/ply_file.hpp"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <string>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

#include "mapping/point_cloud.hpp"

namespace nilio::mapping {

namespace {

core::Error failure(const std::filesystem::path& path) {
  return core::Error{path.string() + ": cannot be written (" + std::strerror(errno) +
                     ") - check that the folder is writable and the disk has space"};
}

std::size_t offset_of(std::uint64_t points) { return kPlyHeaderBytes + points * kPlyRowBytes; }

}  // namespace

core::Result<PlyFile> PlyFile::open(const std::filesystem::path& path, const MapReader& map) {
  const int descriptor = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (descriptor < 0) return failure(path);
  PlyFile file(path, descriptor);
  struct stat status {};
  if (fstat(descriptor, &status) != 0) return failure(path);
  for (const SubmapEntry& entry : map.submaps()) {
    if (offset_of(file.points_ + entry.surfaces) > static_cast<std::size_t>(status.st_size)) break;
    file.points_ += entry.surfaces;
    ++file.submaps_;
  }
  const std::string header = ply_header(file.points_);
  if (!file.write_at(0, {reinterpret_cast<const std::uint8_t*>(header.data()), header.size()}) ||
      ftruncate(descriptor, static_cast<off_t>(offset_of(file.points_))) != 0)
    return failure(path);
  return file;
}

PlyFile::PlyFile(PlyFile&& other) noexcept
    : path_(std::move(other.path_)),
      file_descriptor_(std::exchange(other.file_descriptor_, -1)),
      submaps_(other.submaps_),
      points_(other.points_) {}

PlyFile::~PlyFile() {
  if (file_descriptor_ >= 0) close(file_descriptor_);
}

bool PlyFile::write_at(std::size_t offset, std::span<const std::uint8_t> bytes) const {
  while (!bytes.empty()) {
    const ssize_t written = pwrite(file_descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (written < 0 && errno == EINTR) continue;
    if (written <= 0) return false;
    bytes = bytes.subspan(static_cast<std::size_t>(written));
    offset += static_cast<std::size_t>(written);
  }
  return true;
}

core::Result<std::monostate> PlyFile::update(const MapReader& map) {
  for (; submaps_ < map.submaps().size(); ++submaps_) {
    const SubmapEntry& entry = map.submaps()[submaps_];
    const auto submap = map.load(entry);
    if (!submap) return submap.error();
    ByteWriter rows;
    for (const CloudPoint& point : points_of(*submap, entry.T_map_submap)) put_ply_row(point, rows);
    const std::uint64_t points = points_ + submap->surfaces.size();
    const std::string header = ply_header(points);
    // Readers count on the header: it comes last.
    if (!write_at(offset_of(points_), rows.bytes()) ||
        !write_at(0, {reinterpret_cast<const std::uint8_t*>(header.data()), header.size()}))
      return failure(path_);
    points_ = points;
  }
  return std::monostate{};
}

}  // namespace nilio::mapping
