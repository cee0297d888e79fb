#include "tools/simulate/geometry/mesh.hpp"

#include <cmath>
#include <numbers>

namespace nilio::tools::simulate {

using core::SE3;
using core::Vector3;

std::uint32_t TriangleMesh::add_vertex(const Vector3& p) {
  vertices.emplace_back(p.cast<float>());
  return static_cast<std::uint32_t>(vertices.size() - 1);
}

void TriangleMesh::add_triangle(const Vector3& a, const Vector3& b, const Vector3& c, Material material) {
  const std::uint32_t first = add_vertex(a);
  add_vertex(b);
  add_vertex(c);
  triangles.push_back({first, first + 1, first + 2});
  materials.push_back(material);
}

void TriangleMesh::add_quad(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d,
                            Material material) {
  const std::uint32_t first = add_vertex(a);
  add_vertex(b);
  add_vertex(c);
  add_vertex(d);
  triangles.push_back({first, first + 1, first + 2});
  triangles.push_back({first, first + 2, first + 3});
  materials.insert(materials.end(), 2, material);
}

void TriangleMesh::add_box(const SE3& T_mesh_part, const Vector3& low, const Vector3& high,
                           Material material) {
  const auto corner = [&](bool x, bool y, bool z) {
    return T_mesh_part * Vector3(x ? high.x() : low.x(), y ? high.y() : low.y(), z ? high.z() : low.z());
  };
  const std::uint32_t first = static_cast<std::uint32_t>(vertices.size());
  for (unsigned i = 0; i < 8; ++i) add_vertex(corner((i & 1U) != 0, (i & 2U) != 0, (i & 4U) != 0));
  static constexpr std::array<std::array<std::uint32_t, 3>, 12> faces{{{0, 1, 3},
                                                                       {0, 3, 2},
                                                                       {4, 5, 7},
                                                                       {4, 7, 6},
                                                                       {0, 1, 5},
                                                                       {0, 5, 4},
                                                                       {2, 3, 7},
                                                                       {2, 7, 6},
                                                                       {0, 2, 6},
                                                                       {0, 6, 4},
                                                                       {1, 3, 7},
                                                                       {1, 7, 5}}};
  for (const auto& face : faces) triangles.push_back({first + face[0], first + face[1], first + face[2]});
  materials.insert(materials.end(), faces.size(), material);
}

void TriangleMesh::add_column(const SE3& T_mesh_part, double radius_m, double low_m, double high_m,
                              Material material) {
  constexpr int sides = 8;
  const auto rim = [&](int side, double z) {
    const double angle = 2.0 * std::numbers::pi * side / sides;
    return T_mesh_part * Vector3(radius_m * std::cos(angle), radius_m * std::sin(angle), z);
  };
  const Vector3 top = T_mesh_part * Vector3(0.0, 0.0, high_m);
  for (int side = 0; side < sides; ++side) {
    add_quad(rim(side, low_m), rim(side + 1, low_m), rim(side + 1, high_m), rim(side, high_m), material);
    add_triangle(rim(side, high_m), rim(side + 1, high_m), top, material);
  }
}

void TriangleMesh::append(const TriangleMesh& part, const SE3& T_mesh_part) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (const Eigen::Vector3f& vertex : part.vertices) add_vertex(T_mesh_part * vertex.cast<double>());
  for (const auto& t : part.triangles) triangles.push_back({first + t[0], first + t[1], first + t[2]});
  materials.insert(materials.end(), part.materials.begin(), part.materials.end());
}

void TriangleMesh::add_volume(const SE3& T_mesh_part, const Vector3& centre, PorousVolume volume) {
  const Vector3 forward = T_mesh_part.rotation * Vector3::UnitX();
  const double yaw = std::atan2(forward.y(), forward.x());
  volume.centre = (T_mesh_part * centre).cast<float>();
  volume.cos_yaw = static_cast<float>(std::cos(yaw));
  volume.sin_yaw = static_cast<float>(std::sin(yaw));
  volumes.push_back(volume);
}

SE3 upright_frame(const Vector3& origin, double yaw_rad) {
  return {Eigen::Quaterniond(Eigen::AngleAxisd(yaw_rad, Vector3::UnitZ())), origin};
}

}  // namespace nilio::tools::simulate
