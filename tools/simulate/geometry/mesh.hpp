#pragma once

#include "nilio/core/se3.hpp"

#include <array>
#include <cstdint>
#include <vector>

#include <Eigen/Core>

namespace nilio::tools::simulate {

enum class Material : std::uint8_t {
  kAsphalt,
  kPavement,
  kGrass,
  kPlaster,
  kBrick,
  kGlass,
  kRoofTile,
  kMetal,
  kBark,
  kFoliage,
  kCarPaint,
  kTyre,
  kRetroreflector,
};

/// Share of light at the laser's wavelength (905 nm) that is reflected diffusely, 0 to 1. A retroreflector
/// reflects more than a white diffuse surface and has more than 1.
double reflectivity(Material material);

/// Triangles of one rigid object, metres.
struct TriangleMesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;
  /// One per triangle.
  std::vector<Material> materials;

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
  void append(const TriangleMesh& part, const core::SE3& T_mesh_part);
};

/// Upright frame at `origin`, its x axis turned by `yaw_rad` from that of the mesh.
core::SE3 upright_frame(const core::Vector3& origin, double yaw_rad);

}  // namespace nilio::tools::simulate
