#include "tools/view/live_path.hpp"

#include <cmath>
#include <utility>

namespace nilio::tools::view {

namespace {

constexpr float kStepMetres = 0.1F;

}  // namespace

void LivePath::add(const PathVertex& vertex) {
  if (!vertices_.empty()) {
    const PathVertex& last = vertices_.back();
    const float step =
        std::hypot(vertex.position[0] - last.position[0], vertex.position[1] - last.position[1],
                   vertex.position[2] - last.position[2]);
    if (step < kStepMetres && vertex.state == last.state && vertex.degenerate_axes == last.degenerate_axes)
      return;
  }
  if (vertices_.size() >= kMaxVertices) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < vertices_.size(); i += 2) vertices_[kept++] = vertices_[i];
    vertices_.resize(kept);
    ++generation_;
  }
  vertices_.push_back(vertex);
}

void LivePath::prepend(std::vector<PathVertex> vertices) {
  if (vertices.empty()) return;
  vertices.insert(vertices.end(), vertices_.begin(), vertices_.end());
  vertices_ = std::move(vertices);
  ++generation_;
}

void LivePath::clear() {
  vertices_.clear();
  ++generation_;
}

}  // namespace nilio::tools::view
