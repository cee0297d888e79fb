#pragma once

#include "tools/view/frames.hpp"

#include <cstdint>
#include <vector>

namespace nilio::tools::view {

/// Path of a live drive in bounded memory. Vertices that neither move nor change state are left out; at the
/// limit every second one of the past is removed, and the generation counts up. One thread.
class LivePath {
 public:
  static constexpr std::size_t kMaxVertices = 40'000;

  void add(const PathVertex& vertex);
  void clear();
  /// Puts vertices of the time before the first one in front.
  void prepend(std::vector<PathVertex> vertices);

  [[nodiscard]] const std::vector<PathVertex>& vertices() const { return vertices_; }
  /// Changes whenever vertices were removed: what was sent before is void.
  [[nodiscard]] std::uint64_t generation() const { return generation_; }

 private:
  std::vector<PathVertex> vertices_;
  std::uint64_t generation_ = 1;
};

}  // namespace nilio::tools::view
