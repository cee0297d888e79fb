#pragma once

#include "nilio/core/se3.hpp"

#include "tools/simulate/geometry/porous_volume.hpp"
#include "tools/simulate/geometry/surface.hpp"

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::tools::simulate {

/// Triangles and porous bodies of one rigid object, metres.
struct TriangleMesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  /// One per triangle.
  std::vector<Material> materials;
  std::vector<PorousVolume> volumes;
  /// Whether plants are added as porous bodies; otherwise as separate solid leaves.
  bool porous_plants = false;

  std::uint32_t add_vertex(const core::Vector3& p);
  void add_triangle(const core::Vector3& a, const core::Vector3& b, const core::Vector3& c,
                    Material material);
  /// Corners in order round the quadrilateral.
  void add_quad(const core::Vector3& a, const core::Vector3& b, const core::Vector3& c,
                const core::Vector3& d, Material material);
  /// Box between two corners of the frame T_mesh_part.
  void add_box(const core::SE3& T_mesh_part, const core::Vector3& low, const core::Vector3& high,
               Material material);
  /// Upright prism with eight sides around the z axis of the frame T_mesh_part.
  void add_column(const core::SE3& T_mesh_part, double radius_m, double low_m, double high_m,
                  Material material);
  /// Adds a porous body with its centre at `centre` of the frame, of which only the yaw is used.
  void add_volume(const core::SE3& T_mesh_part, const core::Vector3& centre, PorousVolume volume);
  void append(const TriangleMesh& part, const core::SE3& T_mesh_part);
};

/// Upright frame at `origin`, its x axis turned by `yaw_rad` from that of the mesh.
core::SE3 upright_frame(const core::Vector3& origin, double yaw_rad);

}  // namespace nilio::tools::simulate
