#pragma once

#include "nilio/drivers/source.hpp"

#include <cstddef>
#include <vector>

namespace nilio::tests {

/// Reads a source until it has nothing more, `batch` slots at a time; `end` takes its last state.
template <class Slot>
std::vector<Slot> read_all(drivers::Source<Slot>& source, std::size_t batch = 64,
                           drivers::SourceState* end = nullptr) {
  std::vector<Slot> all;
  std::vector<Slot> slots(batch);
  while (true) {
    const drivers::SourceRead read = source.read(slots, {});
    if (end != nullptr) *end = read.state;
    if (read.state != drivers::SourceState::kData) return all;
    all.insert(all.end(), slots.begin(), slots.begin() + static_cast<std::ptrdiff_t>(read.count));
  }
}

}  // namespace nilio::tests
