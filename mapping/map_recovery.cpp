#include "mapping/map_recovery.hpp"

#include <algorithm>
#include <variant>
#include <vector>

#include "mapping/submap_builder.hpp"

namespace nilio::mapping {

core::Result<std::size_t> recover_map(const std::filesystem::path& folder, core::Time now) {
  const auto map = MapReader::open(folder);
  if (!map) return map.error();
  auto writer = MapWriter::open(folder, map->header().session, now);
  if (!writer) return writer.error();
  core::Result<std::monostate> written = std::monostate{};
  SubmapBuilder builder(
      {},
      [&](const Submap& submap) {
        if (written) written = writer->write(submap, now);
      },
      writer->next_id());
  const auto& submaps = writer->content().submaps();
  const std::size_t neighbours = std::min(submaps.size(), SubmapBuilder::kNeighbours);
  for (std::size_t i = submaps.size() - neighbours; i < submaps.size(); ++i) {
    const auto submap = writer->content().load(submaps[i]);
    if (!submap) return submap.error();
    builder.continue_after(*submap);
  }
  OpenKeyframes open(folder);
  const std::vector<Keyframe> keyframes = open.take(builder.next_id());
  for (const Keyframe& keyframe : keyframes) builder.add(keyframe);
  builder.finish();
  if (!written) return written.error();
  open.remove_before(builder.next_id() + 1);
  return keyframes.size();
}

std::optional<core::SE3> last_pose(const MapReader& map) {
  if (map.submaps().empty()) return std::nullopt;
  const SubmapEntry& last = map.submaps().back();
  const auto submap = map.load(last);
  if (!submap || submap->keyframes.empty()) return std::nullopt;
  return last.T_map_submap * submap->keyframes.back().T_submap_base;
}

}  // namespace nilio::mapping
