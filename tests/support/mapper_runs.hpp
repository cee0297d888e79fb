#pragma once

#include "nilio/core/se3.hpp"

#include "ipc/mapper_process.hpp"
#include "tests/support/eventually.hpp"
#include "tests/support/paths.hpp"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <utility>

#include <catch2/catch.hpp>

#include "mapping/map_folder.hpp"

namespace nilio::tests {

inline std::optional<std::filesystem::path> mapper_program() {
  const std::filesystem::path path = std::filesystem::path(program_folder()) / "nilio-mapper";
  if (std::filesystem::exists(path)) return path;
  WARN("skipped: " << path << " is not built");
  return std::nullopt;
}

/// A mapper that niliod would restart after 10 ms. `change`: of its configuration.
inline std::unique_ptr<ipc::MapperProcess> make_mapper(
    const std::filesystem::path& program, const std::filesystem::path& folder,
    const std::function<void(ipc::MapperProcessConfig&)>& change = nullptr) {
  ipc::MapperProcessConfig config;
  config.executable = program;
  config.folder = folder;
  config.publish = false;
  config.start_interval = core::Duration::from_milliseconds(10.0);
  if (change) change(config);
  auto mapper = ipc::MapperProcess::create(std::move(config));
  if (!mapper) FAIL(mapper.error().message);
  return std::move(mapper).value();
}

inline std::unique_ptr<ipc::ScanCloud> cloud_of(const mapping::Keyframe& keyframe) {
  auto cloud = std::make_unique<ipc::ScanCloud>();
  cloud->stamp_ns = keyframe.stamp.ns;
  for (std::size_t i = 0; i < 3; ++i)
    cloud->position[i] = keyframe.T_odom_base.translation[static_cast<Eigen::Index>(i)];
  cloud->orientation_xyzw = core::xyzw(keyframe.T_odom_base.rotation);
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(cloud->covariance.data()) = keyframe.covariance;
  cloud->count = std::min(keyframe.points.size(), ipc::ScanCloud::kCapacity);
  for (std::size_t i = 0; i < cloud->count; ++i) {
    const mapping::MapPoint& point = keyframe.points[i];
    cloud->points[i] = {point.position.x(), point.position.y(), point.position.z(), point.intensity};
  }
  return cloud;
}

/// Waits until the mapper has read all keyframes, restarting it as niliod does.
inline bool wait_until_read(ipc::MapperProcess& mapper) {
  return eventually([&] {
    mapper.poll();
    return mapper.keyframes().taken() == mapper.keyframes().written();
  });
}

/// Stamps of all keyframes in a map; every submap has to be readable.
inline std::set<std::int64_t> stamps_in(const std::filesystem::path& folder) {
  const auto map = mapping::MapReader::open(folder);
  if (!map) FAIL(map.error().message);
  std::set<std::int64_t> stamps;
  for (const mapping::SubmapEntry& entry : map->submaps()) {
    const auto submap = map->load(entry);
    if (!submap) FAIL(submap.error().message);
    for (const mapping::SubmapKeyframe& keyframe : submap->keyframes) stamps.insert(keyframe.stamp.ns);
  }
  return stamps;
}

}  // namespace nilio::tests
