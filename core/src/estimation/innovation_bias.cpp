#include "core/src/estimation/innovation_bias.hpp"

namespace nilio::core {

namespace {

// Memory of 20 scans: a ship rolls in seconds.
constexpr double kMemory = 0.95;
constexpr double kSigmas = 6.0;

}  // namespace

void InnovationBias::add(const WeightedInnovation& innovation) {
  score_ = kMemory * score_ + innovation.score.segment<2>(1);
  information_ = kMemory * kMemory * information_ + innovation.information.diagonal().segment<2>(1);
}

bool InnovationBias::is_significant() const {
  return (score_.cwiseAbs2().array() > kSigmas * kSigmas * information_.array()).any();
}

}  // namespace nilio::core
