#include "tools/simulate/geometry/ray_scene.hpp"

#include "tools/simulate/geometry/surface.hpp"
#include "tools/simulate/random.hpp"
#include "tools/simulate/town/street_objects.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <utility>

#include <embree3/rtcore.h>

namespace nilio::tools::simulate {

namespace {

using core::SE3;
using core::Vector3;

/// Minimum range: the sensor's housing.
constexpr float kMinDistanceM = 0.4F;
/// Added to half the diagonal: the distance a vehicle travels in 10 ms.
constexpr double kWayM = 0.5;
/// Half the height of a car, a truck.
constexpr double kCarMiddleM = 0.9;
constexpr double kTruckMiddleM = 2.0;

double middle_height(std::size_t model) { return model < kCarModels ? kCarMiddleM : kTruckMiddleM; }

float radius_of(std::size_t model) {
  const CarSize size = car_size(model);
  const core::Vector3 corner(0.5 * size.length_m, 0.5 * size.width_m, 1.4 * middle_height(model));
  return static_cast<float>(corner.norm() + kWayM);
}

/// Identifier of the geometry with the triangles; porous bodies follow.
constexpr unsigned kTriangles = 0;

struct DeviceDeleter {
  void operator()(RTCDevice device) const { rtcReleaseDevice(device); }
};
struct SceneDeleter {
  void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
};
using Device = std::unique_ptr<std::remove_pointer_t<RTCDevice>, DeviceDeleter>;
using EmbreeScene = std::unique_ptr<std::remove_pointer_t<RTCScene>, SceneDeleter>;

/// A mesh ready for casting and the materials of its triangles.
struct CastMesh {
  EmbreeScene scene;
  std::vector<Material> materials;
  /// Their addresses are those of the scene's second geometry.
  std::unique_ptr<const std::vector<PorousVolume>> volumes;

  [[nodiscard]] Material material_of(unsigned geometry, unsigned primitive) const {
    return geometry == kTriangles ? materials[primitive] : (*volumes)[primitive].material;
  }
};

void bounds_of_volume(const RTCBoundsFunctionArguments* args) {
  const PorousVolume& volume =
      (*static_cast<const std::vector<PorousVolume>*>(args->geometryUserPtr))[args->primID];
  const Eigen::Vector3f& half = volume.half_size;
  const float c = std::abs(volume.cos_yaw);
  const float s = std::abs(volume.sin_yaw);
  const Eigen::Vector3f reach(c * half.x() + s * half.y(), s * half.x() + c * half.y(), half.z());
  const Eigen::Vector3f low = volume.centre - reach;
  const Eigen::Vector3f high = volume.centre + reach;
  *args->bounds_o = {low.x(), low.y(), low.z(), 0.0F, high.x(), high.y(), high.z(), 0.0F};
}

void intersect_volume(const RTCIntersectFunctionNArguments* args) {
  const auto& volumes = *static_cast<const std::vector<PorousVolume>*>(args->geometryUserPtr);
  const unsigned count = args->N;
  RTCRayN* const rays = RTCRayHitN_RayN(args->rayhit, count);
  RTCHitN* const hits = RTCRayHitN_HitN(args->rayhit, count);
  const std::uint64_t key = mix_bits(args->primID);
  for (unsigned i = 0; i < count; ++i) {
    if (args->valid[i] == 0) continue;
    const Eigen::Vector3f origin(RTCRayN_org_x(rays, count, i), RTCRayN_org_y(rays, count, i),
                                 RTCRayN_org_z(rays, count, i));
    const Eigen::Vector3f direction(RTCRayN_dir_x(rays, count, i), RTCRayN_dir_y(rays, count, i),
                                    RTCRayN_dir_z(rays, count, i));
    const auto found = cast_at_volume(volumes[args->primID], key, origin, direction,
                                      RTCRayN_tnear(rays, count, i), RTCRayN_tfar(rays, count, i));
    if (!found) continue;
    RTCRayN_tfar(rays, count, i) = found->distance_m;
    RTCHitN_Ng_x(hits, count, i) = found->normal.x();
    RTCHitN_Ng_y(hits, count, i) = found->normal.y();
    RTCHitN_Ng_z(hits, count, i) = found->normal.z();
    RTCHitN_primID(hits, count, i) = args->primID;
    RTCHitN_geomID(hits, count, i) = args->geomID;
    RTCHitN_instID(hits, count, i, 0) = args->context->instID[0];
  }
}

void attach_volumes(RTCDevice device, CastMesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned>(mesh.volumes->size()));
  // The callbacks only read.
  rtcSetGeometryUserData(geometry, const_cast<std::vector<PorousVolume>*>(mesh.volumes.get()));
  rtcSetGeometryBoundsFunction(
      geometry, [](const RTCBoundsFunctionArguments* args) { bounds_of_volume(args); }, nullptr);
  rtcSetGeometryIntersectFunction(geometry,
                                  [](const RTCIntersectFunctionNArguments* args) { intersect_volume(args); });
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(mesh.scene.get(), geometry);
  rtcReleaseGeometry(geometry);
}

/// `scene` is null when memory is short.
CastMesh make_cast_mesh(RTCDevice device, const TriangleMesh& mesh) {
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(Eigen::Vector3f), mesh.vertices.size()));
  void* indices = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                          3 * sizeof(std::uint32_t), mesh.triangles.size());
  if (vertices == nullptr || indices == nullptr) {
    rtcReleaseGeometry(geometry);
    return {};
  }
  for (const Eigen::Vector3f& vertex : mesh.vertices) vertices = std::copy_n(vertex.data(), 3, vertices);
  std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * 3 * sizeof(std::uint32_t));
  rtcCommitGeometry(geometry);
  EmbreeScene scene(rtcNewScene(device));
  // Robust: no ray passes between two triangles of the ground.
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  rtcAttachGeometry(scene.get(), geometry);
  rtcReleaseGeometry(geometry);
  CastMesh result{std::move(scene), mesh.materials, nullptr};
  if (!mesh.volumes.empty()) {
    result.volumes = std::make_unique<const std::vector<PorousVolume>>(mesh.volumes);
    attach_volumes(device, result);
  }
  rtcCommitScene(result.scene.get());
  return result;
}

float incidence_cosine(const Eigen::Vector3f& normal, const Eigen::Vector3f& direction) {
  const float norm = normal.norm();
  return norm > 0.0F ? std::min(1.0F, std::abs(normal.dot(direction)) / norm) : 0.0F;
}

/// Casts one ray against one car; replaces `hit` by a nearer one.
void cast_at_car(const CastMesh& mesh, const SE3& T_world_car, const Eigen::Vector3f& origin,
                 const Eigen::Vector3f& direction, float max_distance_m, RayHit& hit) {
  const SE3 T_car_world = T_world_car.inverse();
  const Eigen::Vector3f o = (T_car_world * origin.cast<double>()).cast<float>();
  const Eigen::Vector3f d = (T_car_world.rotation * direction.cast<double>()).cast<float>();
  RTCRayHit ray{};
  ray.ray.org_x = o.x();
  ray.ray.org_y = o.y();
  ray.ray.org_z = o.z();
  ray.ray.tnear = kMinDistanceM;
  ray.ray.dir_x = d.x();
  ray.ray.dir_y = d.y();
  ray.ray.dir_z = d.z();
  ray.ray.tfar = hit.hit ? hit.distance_m : max_distance_m;
  ray.ray.mask = ~0U;
  ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(mesh.scene.get(), &context, &ray);
  if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return;
  hit.hit = true;
  hit.distance_m = ray.ray.tfar;
  hit.incidence_cosine = incidence_cosine({ray.hit.Ng_x, ray.hit.Ng_y, ray.hit.Ng_z}, d);
  hit.material = mesh.material_of(ray.hit.geomID, ray.hit.primID);
}

/// Triangles of retroreflectors, those of one box together.
std::vector<Retroreflector> find_retroreflectors(const TriangleMesh& mesh) {
  std::vector<Retroreflector> found;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (mesh.materials[t] != Material::kRetroreflector) continue;
    Eigen::Vector3f centre = Eigen::Vector3f::Zero();
    for (const std::uint32_t v : mesh.triangles[t]) centre += mesh.vertices[v] / 3.0F;
    float radius = 0.0F;
    for (const std::uint32_t v : mesh.triangles[t])
      radius = std::max(radius, (mesh.vertices[v] - centre).norm());
    if (!found.empty() && (found.back().centre - centre).norm() < 0.5F) continue;
    found.push_back({centre, 0.7F * radius});
  }
  return found;
}

/// Whether the ray passes the car's bounding sphere before `max_distance_m`.
bool may_hit(const NearbyCar& nearby, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
             float max_distance_m) {
  const Eigen::Vector3f to_centre = nearby.centre - origin;
  const float along = to_centre.dot(direction);
  if (along < -nearby.radius_m || along > max_distance_m + nearby.radius_m) return false;
  return to_centre.squaredNorm() - along * along < nearby.radius_m * nearby.radius_m;
}

}  // namespace

struct RayScene::State {
  // Destroyed in reverse order: scenes before the device.
  Device device;
  CastMesh still;
  std::array<CastMesh, kVehicleModels> models;
  std::array<float, kVehicleModels> radii{};
  std::vector<MovingCar> cars;
  SurfaceDetail detail;
  std::vector<Retroreflector> retroreflectors;
};

RayScene::RayScene(std::unique_ptr<State> state) : state_(std::move(state)) {}
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;
RayScene::~RayScene() = default;

core::Result<RayScene> RayScene::create(const TriangleMesh& still, std::vector<MovingCar> cars,
                                        const SurfaceDetail& detail) {
  auto state = std::make_unique<State>();
  // One thread and the same instructions everywhere: the hierarchy, and with it the choice between two
  // coinciding triangles, and the distances are then reproducible.
  state->device.reset(rtcNewDevice("threads=1,isa=sse4.2"));
  if (!state->device) {
    return core::Error{"Embree cannot start (error " + std::to_string(rtcGetDeviceError(nullptr)) +
                       "); is this a 64-bit x86 processor with SSE4.2?"};
  }
  state->still = make_cast_mesh(state->device.get(), still);
  for (std::size_t model = 0; model < kVehicleModels; ++model) {
    state->radii[model] = radius_of(model);
    state->models[model] = make_cast_mesh(state->device.get(), make_car(model));
  }
  const RTCError error = rtcGetDeviceError(state->device.get());
  if (error != RTC_ERROR_NONE || !state->still.scene) {
    return core::Error{"Embree cannot build the scene of " + std::to_string(still.triangles.size()) +
                       " triangles (error " + std::to_string(error) + "); take a shorter --length"};
  }
  state->cars = std::move(cars);
  state->detail = detail;
  state->retroreflectors = find_retroreflectors(still);
  return RayScene(std::move(state));
}

const std::vector<MovingCar>& RayScene::cars() const { return state_->cars; }

const std::vector<Retroreflector>& RayScene::retroreflectors() const { return state_->retroreflectors; }

void RayScene::find_cars(double time_s, const Vector3& place, double range_m,
                         std::vector<NearbyCar>& nearby) const {
  nearby.clear();
  for (const MovingCar& car : state_->cars) {
    const std::optional<SE3> pose = car.pose(time_s);
    if (!pose || (pose->translation - place).norm() > range_m) continue;
    const Vector3 middle(0.0, 0.0, middle_height(car.model));
    nearby.push_back({&car, (*pose * middle).cast<float>(), state_->radii[car.model]});
  }
}

void RayScene::cast(const RayGroup& rays, float max_distance_m, std::span<const NearbyCar> nearby,
                    std::array<RayHit, kRayGroup>& hits) const {
  alignas(64) RTCRayHit16 group;
  alignas(64) std::array<int, kRayGroup> valid;
  valid.fill(-1);
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    group.ray.org_x[i] = rays.origin[i].x();
    group.ray.org_y[i] = rays.origin[i].y();
    group.ray.org_z[i] = rays.origin[i].z();
    group.ray.dir_x[i] = rays.direction[i].x();
    group.ray.dir_y[i] = rays.direction[i].y();
    group.ray.dir_z[i] = rays.direction[i].z();
    group.ray.tnear[i] = kMinDistanceM;
    group.ray.tfar[i] = max_distance_m;
    group.ray.time[i] = 0.0F;
    group.ray.mask[i] = ~0U;
    group.ray.flags[i] = 0;
    group.ray.id[i] = static_cast<unsigned>(i);
    group.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    group.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
  }
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(valid.data(), state_->still.scene.get(), &context, &group);

  const bool detailed = state_->detail.grass_m > 0.0F || state_->detail.rough;
  for (std::size_t i = 0; i < kRayGroup; ++i) {
    RayHit& hit = hits[i];
    hit = {};
    if (group.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID) {
      hit.hit = true;
      hit.distance_m = group.ray.tfar[i];
      hit.incidence_cosine =
          incidence_cosine({group.hit.Ng_x[i], group.hit.Ng_y[i], group.hit.Ng_z[i]}, rays.direction[i]);
      hit.material = state_->still.material_of(group.hit.geomID[i], group.hit.primID[i]);
      if (detailed) add_detail(state_->detail, rays.origin[i], rays.direction[i], hit);
    }
    for (const NearbyCar& near_car : nearby) {
      if (!may_hit(near_car, rays.origin[i], rays.direction[i], hit.hit ? hit.distance_m : max_distance_m))
        continue;
      const std::optional<SE3> pose = near_car.car->pose(rays.time_s[i]);
      if (!pose) continue;
      cast_at_car(state_->models[near_car.car->model], *pose, rays.origin[i], rays.direction[i],
                  max_distance_m, hit);
    }
  }
}

}  // namespace nilio::tools::simulate
