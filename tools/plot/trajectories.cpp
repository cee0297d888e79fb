#include "tools/plot/trajectories.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <utility>

namespace nilio::tools::plot {

namespace {

/// Path travelled along each body axis, metres.
Eigen::Vector3d travel_along_body_axes(const Trajectory& trajectory) {
  Eigen::Vector3d travel = Eigen::Vector3d::Zero();
  for (std::size_t i = 1; i < trajectory.poses.size(); ++i)
    travel += (trajectory.poses[i - 1].inverse() * trajectory.poses[i]).translation().cwiseAbs();
  return travel;
}

/// KITTI poses belong to a camera (z forward, y down) or to a LiDAR (x forward, z up).
bool has_camera_poses(const Trajectory& trajectory) {
  const Eigen::Vector3d travel = travel_along_body_axes(trajectory);
  return trajectory.format == TrajectoryFormat::kKitti && travel.z() > travel.x();
}

class TopView {
 public:
  explicit TopView(bool camera) : camera_(camera) {}
  [[nodiscard]] Eigen::Vector2d project(const Eigen::Vector3d& p) const {
    return camera_ ? Eigen::Vector2d(p.x(), p.z()) : Eigen::Vector2d(p.x(), p.y());
  }
  [[nodiscard]] double height(const Eigen::Vector3d& p) const { return camera_ ? -p.y() : p.z(); }
  [[nodiscard]] std::vector<Eigen::Vector2d> project(const std::vector<Pose>& poses) const {
    std::vector<Eigen::Vector2d> points;
    points.reserve(poses.size());
    for (const Pose& pose : poses) points.push_back(project(Eigen::Vector3d(pose.translation())));
    return points;
  }
  [[nodiscard]] const char* y_label() const { return camera_ ? "z [m]" : "y [m]"; }

 private:
  bool camera_;
};

std::string name_with_errors(const std::string& name, const std::vector<double>& errors, double length_m) {
  const evaluate::Statistics statistics = evaluate::compute_statistics(errors);
  std::array<char, 160> text{};
  std::snprintf(text.data(), text.size(), "  (APE %.2f m, end %.2f m = %.2f %%)", statistics.rmse,
                errors.back(), length_m > 0.0 ? 100.0 * errors.back() / length_m : 0.0);
  return name + text.data();
}

/// An estimate and what it is compared with.
struct Compared {
  const Trajectory* estimate = nullptr;
  Pose transform = Pose::Identity();  ///< of the alignment
  std::optional<evaluate::PosePairs> pairs;
  evaluate::ErrorSeries errors;  ///< absolute
  std::vector<double> times;     ///< of the pairs: seconds since the first pose, or numbers of lines
  std::vector<Pose> moved;       ///< all poses after the alignment
};

double time_of(const Trajectory& trajectory, std::size_t i) {
  if (trajectory.stamps.empty()) return static_cast<double>(i);
  return (trajectory.stamps[i] - trajectory.stamps.front()).seconds();
}

core::Result<Compared> compare(const Trajectory& estimate, const std::optional<Trajectory>& truth,
                               evaluate::Alignment alignment) {
  Compared compared;
  compared.estimate = &estimate;
  if (truth) {
    auto pairs = evaluate::associate(*truth, estimate, {});
    if (!pairs) return pairs.error();
    compared.transform = evaluate::align(*pairs, alignment).front() * pairs->estimate.front().inverse();
    compared.errors = evaluate::absolute_errors(*pairs, alignment);
    for (const std::size_t index : pairs->estimate_index) compared.times.push_back(time_of(estimate, index));
    compared.pairs = std::move(pairs).value();
  }
  for (const Pose& pose : estimate.poses) compared.moved.push_back(compared.transform * pose);
  return compared;
}

Curve curve_of(const std::string& name, const std::vector<double>& x, const std::vector<double>& y) {
  Curve curve{name, {}};
  for (std::size_t i = 0; i < y.size(); ++i) curve.points.emplace_back(x[i], y[i]);
  return curve;
}

const char* time_label(const Compared& compared) {
  return compared.estimate->stamps.empty() ? "pose" : "time [s]";
}

/// Error of each pose of the estimate, that of the nearest earlier pair where it has none.
std::vector<double> errors_of_poses(const Compared& compared) {
  std::vector<double> errors(compared.moved.size(), 0.0);
  std::size_t pair = 0;
  const std::vector<std::size_t>& indices = compared.pairs->estimate_index;
  for (std::size_t i = 0; i < errors.size(); ++i) {
    while (pair + 1 < indices.size() && indices[pair + 1] <= i) ++pair;
    errors[i] = compared.errors.translation_m[pair];
  }
  return errors;
}

/// Colours the curves of the top view by one scale that ends at the 95th percentile.
void shade(const std::vector<Compared>& all, Panel& top) {
  std::vector<double> values;
  for (const Compared& one : all)
    values.insert(values.end(), one.errors.translation_m.begin(), one.errors.translation_m.end());
  std::sort(values.begin(), values.end());
  const double high =
      std::max(values[static_cast<std::size_t>(0.95 * static_cast<double>(values.size() - 1))], 1e-6);
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (const double error : errors_of_poses(all[i])) top.curves[i].shades.push_back(error / high);
  }
  const auto three_digits = [](double value) {
    const double step = std::pow(10.0, std::floor(std::log10(std::max(value, 1e-9))) - 2.0);
    return std::round(value / step) * step;
  };
  top.key = ColourKey{"position error [m], end: 95 %", 0.0, three_digits(0.5 * high), three_digits(high)};
}

Panel top_panel(const std::vector<Compared>& all, const std::optional<Trajectory>& truth, const TopView& view,
                std::vector<Eigen::Vector3f> map, bool colour_by_error) {
  Panel top;
  top.x.label = "x [m]";
  top.y.label = view.y_label();
  top.is_top_view = true;
  if (truth) top.reference = Curve{"truth: " + truth->path, view.project(truth->poses)};
  for (const Compared& one : all) {
    std::string name = one.estimate->path;
    if (one.pairs) name = name_with_errors(name, one.errors.translation_m, path_length(one.pairs->truth));
    top.curves.push_back({name, view.project(one.moved)});
  }
  for (Eigen::Vector3f& point : map) {
    const Eigen::Vector3d moved = all.front().transform * point.cast<double>();
    const Eigen::Vector2d seen = view.project(moved);
    point = Eigen::Vector3d(seen.x(), seen.y(), view.height(moved)).cast<float>();
  }
  top.map = std::move(map);
  if (colour_by_error) shade(all, top);
  return top;
}

Panel error_panel(const std::vector<Compared>& all, PanelKind kind, const evaluate::RelativeStep& step) {
  Panel panel;
  panel.x.label = kind == PanelKind::kError ? "distance travelled [m]" : time_label(all.front());
  panel.y = {"position error [m]", false, true};
  if (kind == PanelKind::kRotation) panel.y.label = "rotation error [deg]";
  if (kind == PanelKind::kRpe) {
    std::array<char, 64> label{};
    std::snprintf(label.data(), label.size(), step.metres ? "RPE over %g m [m]" : "RPE over %g poses [m]",
                  step.metres.value_or(static_cast<double>(step.frames)));
    panel.y.label = label.data();
  }
  for (const Compared& one : all) {
    const std::string& name = one.estimate->path;
    if (kind == PanelKind::kError) {
      panel.curves.push_back(curve_of(name, path_lengths(one.pairs->truth), one.errors.translation_m));
    } else if (kind == PanelKind::kRpe) {
      const evaluate::ErrorSeries relative = evaluate::relative_errors(*one.pairs, step);
      std::vector<double> times;
      for (const std::size_t pair : relative.pair) times.push_back(one.times[pair]);
      panel.curves.push_back(curve_of(name, times, relative.translation_m));
    } else {
      const bool rotation = kind == PanelKind::kRotation;
      panel.curves.push_back(
          curve_of(name, one.times, rotation ? one.errors.rotation_deg : one.errors.translation_m));
    }
  }
  return panel;
}

/// Share of the poses by position error, as steps.
Panel histogram_panel(const std::vector<Compared>& all) {
  constexpr std::size_t kBins = 40;
  Panel panel;
  panel.x.label = "position error [m]";
  panel.y = {"share of the poses [%]", false, true};
  double most = 0.0;
  for (const Compared& one : all)
    for (const double error : one.errors.translation_m) most = std::max(most, error);
  const double width = std::max(most, 1e-9) / static_cast<double>(kBins);
  for (const Compared& one : all) {
    std::vector<double> counts(kBins, 0.0);
    const std::vector<double>& errors = one.errors.translation_m;
    for (const double error : errors)
      counts[std::min(kBins - 1, static_cast<std::size_t>(error / width))] += 1.0;
    Curve curve{one.estimate->path, {}};
    for (std::size_t i = 0; i < kBins; ++i) {
      const double share = 100.0 * counts[i] / static_cast<double>(errors.size());
      curve.points.emplace_back(static_cast<double>(i) * width, share);
      curve.points.emplace_back(static_cast<double>(i + 1) * width, share);
    }
    panel.curves.push_back(std::move(curve));
  }
  return panel;
}

/// x, y and z or roll, pitch and yaw over time; the truth in grey.
void add_components(const std::vector<Compared>& all, bool angles, std::vector<Panel>& panels) {
  constexpr std::array kPositions{"x [m]", "y [m]", "z [m]"};
  constexpr std::array kAngles{"roll [deg]", "pitch [deg]", "yaw [deg]"};
  const auto components = [angles](const std::vector<Pose>& poses) {
    if (angles) return evaluate::roll_pitch_yaw_deg(poses);
    std::array<std::vector<double>, 3> positions;
    for (const Pose& pose : poses) {
      for (std::size_t k = 0; k < 3; ++k)
        positions[k].push_back(pose.translation()[static_cast<Eigen::Index>(k)]);
    }
    return positions;
  };
  for (std::size_t k = 0; k < 3; ++k) {
    Panel panel;
    panel.x.label = time_label(all.front());
    panel.y.label = angles ? kAngles[k] : kPositions[k];
    if (all.front().pairs)
      panel.reference = curve_of("truth", all.front().times, components(all.front().pairs->truth)[k]);
    for (const Compared& one : all) {
      std::vector<double> times;
      for (std::size_t i = 0; i < one.moved.size(); ++i) times.push_back(time_of(*one.estimate, i));
      panel.curves.push_back(curve_of(one.estimate->path, times, components(one.moved)[k]));
    }
    panels.push_back(std::move(panel));
  }
}

}  // namespace

core::Result<Figure> trajectory_figure(const std::vector<Trajectory>& estimates,
                                       const std::optional<Trajectory>& truth,
                                       std::vector<Eigen::Vector3f> map,
                                       const TrajectoryFigureOptions& options) {
  const bool camera = options.plane == Plane::kAuto ? has_camera_poses(truth ? *truth : estimates.front())
                                                    : options.plane == Plane::kXz;
  std::vector<PanelKind> kinds = options.panels;
  if (kinds.empty()) {
    kinds.push_back(PanelKind::kTop);
    if (truth) kinds.push_back(PanelKind::kError);
  }
  // The arrangement has the top view first.
  std::stable_partition(kinds.begin(), kinds.end(), [](PanelKind kind) { return kind == PanelKind::kTop; });
  const bool needs_truth =
      options.colour_by_error || std::any_of(kinds.begin(), kinds.end(), [](PanelKind kind) {
        return kind != PanelKind::kTop && kind != PanelKind::kXyz && kind != PanelKind::kRpy;
      });
  if (needs_truth && !truth) return core::Error{"errors need a true trajectory - add --truth"};
  std::vector<Compared> all;
  for (const Trajectory& estimate : estimates) {
    auto compared = compare(estimate, truth, options.alignment);
    if (!compared) return compared.error();
    all.push_back(std::move(compared).value());
  }
  Figure figure;
  figure.title = options.title;
  for (const PanelKind kind : kinds) {
    if (kind == PanelKind::kTop) {
      figure.panels.push_back(
          top_panel(all, truth, TopView(camera), std::move(map), options.colour_by_error));
      map.clear();
    } else if (kind == PanelKind::kHistogram) {
      figure.panels.push_back(histogram_panel(all));
    } else if (kind == PanelKind::kXyz || kind == PanelKind::kRpy) {
      add_components(all, kind == PanelKind::kRpy, figure.panels);
    } else {
      figure.panels.push_back(error_panel(all, kind, options.relative_step));
    }
  }
  return figure;
}

std::optional<std::string> find_mixed_frames(const std::vector<Trajectory>& estimates,
                                             const std::optional<Trajectory>& truth, bool has_map) {
  constexpr double clear_ratio = 2.0;
  constexpr double shortest_m = 1.0;
  std::string cameras;
  std::string vehicles;
  const auto classify = [&](const Trajectory& trajectory) {
    const Eigen::Vector3d travel = travel_along_body_axes(trajectory);
    if (travel.norm() < shortest_m) return;
    if (travel.z() > clear_ratio * travel.x()) cameras = trajectory.path;
    if (travel.x() > clear_ratio * travel.z()) vehicles = trajectory.path;
  };
  if (truth) classify(*truth);
  for (const Trajectory& estimate : estimates) classify(estimate);
  if (has_map && !cameras.empty())
    return cameras + " has camera poses (z forward), and a map of niliod is z up";
  if (cameras.empty() || vehicles.empty()) return std::nullopt;
  return cameras + " has camera poses (z forward), " + vehicles + " has vehicle or LiDAR poses (x forward)";
}

}  // namespace nilio::tools::plot
