#pragma once

#include "core/src/registration/gauss_newton.hpp"

#include "mapping/loops/surface_index.hpp"

namespace nilio::mapping {

/// Weight of a residual in the Geman-McClure kernel of `scale`.
inline double geman_mcclure(double r, double scale) {
  const double ratio = scale * scale / (scale * scale + r * r);
  return ratio * ratio;
}

/// Adds a residual `row . delta + r`.
inline void add_row(const core::Vector6& row, double r, double weight, core::NormalEquations& equations) {
  equations.H.noalias() += weight * row * row.transpose();
  equations.b.noalias() += weight * r * row;
  equations.weighted_square_error += weight * r * r;
  equations.weight_sum += weight;
}

/// Adds the distance of a point from a plane. `p`: in axes of the moving frame, errors on the right:
/// q = T (p + rho + theta x p). `R`: rotation of T.
inline void add_plane(const Surface& plane, const core::Vector3& p, const core::Vector3& q,
                      const core::Matrix3& R, double kernel_m, core::NormalEquations& equations) {
  const core::Vector3 d = q - plane.mean.cast<double>();
  const core::Vector3 m = R.transpose() * plane.normal.cast<double>();
  const double r = d.dot(plane.normal.cast<double>());
  core::Vector6 row;
  row << m, p.cross(m);
  add_row(row, r, geman_mcclure(r, kernel_m), equations);
}

}  // namespace nilio::mapping
