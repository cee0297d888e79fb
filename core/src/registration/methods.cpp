#include "core/src/registration/methods.hpp"

#include "core/src/registration/point_factors.hpp"

#include <algorithm>

namespace nilio::core {

namespace {

RegistrationResult refine_with_planes(const RegistrationMaps& maps, std::span<const Eigen::Vector3f> points,
                                      const SE3& T_map_guess, const PlaneMetric& metric,
                                      const SolverOptions& options) {
  return register_planes(*maps.planes, points, T_map_guess, metric, options);
}

RegistrationResult refine_with_ndt(const RegistrationMaps& maps, std::span<const Eigen::Vector3f> points,
                                   const SE3& T_map_guess, const PlaneMetric& metric,
                                   const SolverOptions& options) {
  RegistrationResult result = register_ndt(*maps.gaussians, points, T_map_guess, kNdtKernelSchedule, options);
  // NDT has no inliers: they are counted on the plane map, as for the other methods.
  if (result.iterations > 0 && result.T_map_moving.is_finite()) {
    const NormalEquations planes = plane_equations(*maps.planes, points, result.T_map_moving, metric);
    result.equations.inliers = planes.inliers;
    result.equations.agreement = planes.agreement;
  }
  return result;
}

/// Stored points sample the surface between them: a gate or kernel narrower than their spacing would favour
/// points that are hit again, such as the rings on a flat floor, which move with the vehicle.
PlaneMetric not_finer_than(const PointMap& map, PlaneMetric metric) {
  metric.gate_m = std::max(metric.gate_m, map.config().voxel_size_m);
  metric.kernel_scale_m = std::max(metric.kernel_scale_m, map.spacing_m());
  return metric;
}

RegistrationResult refine_with_lines(const RegistrationMaps& maps, std::span<const Eigen::Vector3f> points,
                                     const SE3& T_map_guess, const PlaneMetric& metric,
                                     const SolverOptions& options) {
  return register_lines(*maps.points, points, T_map_guess, not_finer_than(*maps.points, metric), options);
}

RegistrationResult refine_with_points(const RegistrationMaps& maps, std::span<const Eigen::Vector3f> points,
                                      const SE3& T_map_guess, const PlaneMetric& metric,
                                      const SolverOptions& options) {
  return register_points(*maps.points, points, T_map_guess, not_finer_than(*maps.points, metric), options);
}

constexpr std::array<RegistrationMethodInfo, 5> kMethods = {{
    {RegistrationMethod::kNdtIcp, "ndt_icp", true, false, refine_with_planes},
    {RegistrationMethod::kNdt, "ndt", true, false, refine_with_ndt},
    {RegistrationMethod::kIcpPlane, "icp_plane", false, false, refine_with_planes},
    {RegistrationMethod::kIcpLine, "icp_line", false, true, refine_with_lines},
    {RegistrationMethod::kIcpPoint, "icp_point", false, true, refine_with_points},
}};

}  // namespace

RegistrationResult register_coarsely(const VoxelMap& gaussians, std::span<const Eigen::Vector3f> points,
                                     const SE3& T_map_guess, int max_iterations, ComputeBudget* budget,
                                     const CoarseEpsilon& epsilon) {
  SolverOptions options;
  options.max_iterations = max_iterations;
  options.budget = budget;
  options.translation_epsilon_m = epsilon.translation_m;
  options.rotation_epsilon_rad = epsilon.rotation_rad;
  return register_ndt(gaussians, points, T_map_guess, kNdtKernelSchedule, options);
}

std::span<const RegistrationMethodInfo> registration_methods() { return kMethods; }

const RegistrationMethodInfo& info_of(RegistrationMethod method) {
  return kMethods[static_cast<std::size_t>(method)];
}

const RegistrationMethodInfo* find_registration_method(std::string_view name) {
  const auto found =
      std::find_if(kMethods.begin(), kMethods.end(), [&](const auto& method) { return method.name == name; });
  return found == kMethods.end() ? nullptr : &*found;
}

const char* name_of(RegistrationMethod method) { return info_of(method).name; }

std::optional<RegistrationMethod> registration_method_of(std::string_view name) {
  const RegistrationMethodInfo* info = find_registration_method(name);
  if (info == nullptr) return std::nullopt;
  return info->method;
}

}  // namespace nilio::core
