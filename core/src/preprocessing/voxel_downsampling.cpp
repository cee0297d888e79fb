#include "core/src/preprocessing/voxel_downsampling.hpp"

#include <bit>

namespace nilio::core {

VoxelDownsampler::VoxelDownsampler(std::size_t capacity)
    : slots_(std::bit_ceil(2 * capacity)), mask_(slots_.size() - 1) {}

void VoxelDownsampler::begin(float voxel_size_m) {
  inverse_size_ = 1.0F / voxel_size_m;
  used_ = 0;
  if (++generation_ >> kGenerationBits != 0) {
    std::fill(slots_.begin(), slots_.end(), 0);
    generation_ = 1;
  }
}

}  // namespace nilio::core
