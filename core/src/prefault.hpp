#pragma once

#include <cstddef>

namespace nilio::core {

/// Reserves vectors and touches their memory, so that no scan waits for pages. They are empty afterwards.
template <class... Vectors>
void prefault(std::size_t capacity, Vectors&... vectors) {
  (vectors.resize(capacity), ...);
  (vectors.clear(), ...);
}

}  // namespace nilio::core
