#include "core/src/preprocessing/deskewing.hpp"

#include <algorithm>

namespace nilio::core {

SweepMotion::SweepMotion(const SweepSpan& span, const MotionState& at_middle, const MotionInputs& inputs)
    : span_(span), middle_twist_(at_middle.twist()) {
  const double cell_s = span.seconds() / static_cast<double>(kSweepCells);
  const Duration half_cell = Duration::from_seconds(0.5 * cell_s);
  const SE3 T_middle_map = at_middle.T_map_base.inverse();
  const auto fill = [&](const MotionState& state, Cell& cell) {
    const SE3 T_middle_t = T_middle_map * state.T_map_base;
    cell.rotation = T_middle_t.rotation.toRotationMatrix().cast<float>();
    cell.translation = T_middle_t.translation.cast<float>();
    cell.angular_velocity = state.angular_velocity.cast<float>();
    cell.velocity = state.velocity.cast<float>();
  };
  MotionState state = at_middle;
  for (std::size_t i = kSweepCells / 2; i < kSweepCells; ++i) {
    state = propagated(state, inputs, state.time + (i == kSweepCells / 2 ? half_cell : half_cell * 2));
    fill(state, cells_[i]);
  }
  state = propagated(state, inputs, span.end);
  T_middle_end_ = T_middle_map * state.T_map_base;
  end_twist_ = state.twist();
  state = at_middle;
  for (std::size_t i = kSweepCells / 2; i-- > 0;) {
    state = propagated(state, inputs, state.time - (i == kSweepCells / 2 - 1 ? half_cell : half_cell * 2));
    fill(state, cells_[i]);
  }
}

void SweepMotion::deskew(const std::vector<SweepPoint>& points, std::vector<Eigen::Vector3f>& output) const {
  output.resize(points.size());
  const auto sweep = static_cast<float>(span_.seconds());
  const float cells_per_second = sweep > 0.0F ? static_cast<float>(kSweepCells) / sweep : 0.0F;
  const float cell_s = sweep / static_cast<float>(kSweepCells);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3f& p = points[i].position;
    const float since_start = points[i].time_s + sweep;
    const auto index = static_cast<std::size_t>(
        std::clamp(since_start * cells_per_second, 0.0F, static_cast<float>(kSweepCells - 1)));
    const Cell& cell = cells_[index];
    const float offset = since_start - (static_cast<float>(index) + 0.5F) * cell_s;
    output[i] =
        cell.rotation * (p + offset * (cell.velocity + cell.angular_velocity.cross(p))) + cell.translation;
  }
}

}  // namespace nilio::core
