#pragma once

#include "nilio/core/time.hpp"

#include "ipc/dds/map_publisher.hpp"
#include "ipc/mapper_process.hpp"
#include "ipc/overwriting_ring.hpp"
#include "ipc/scan_cloud.hpp"
#include "ipc/shared_object.hpp"
#include "ipc/wake_event.hpp"

#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>

#include "mapping/map_folder.hpp"
#include "mapping/submap_builder.hpp"

namespace nilio::daemon {

/// Shared memory of nilio-mapper with niliod.
struct MapperInputs {
  ipc::OverwritingRing<ipc::ScanCloud> keyframes;
  ipc::WakeEvent wake;
  ipc::SharedObject<ipc::MapperState> state;
  std::optional<ipc::OverwritingRing<ipc::SubmapCloud>> submaps;  ///< to niliod, if it wants them
};

/// Main loop of nilio-mapper: keyframes to submaps, submaps to disk and DDS. Everything happens in one thread
/// at normal priority; while it works, keyframes wait in the ring, or are overwritten and counted.
class MapperLoop {
 public:
  /// `parent`: end with this process; 0 = none. `signals`: signalfd of the stop signals. `publisher` may be
  /// null; `kept_submaps`: what it keeps for late subscribers.
  MapperLoop(pid_t parent, int signals, MapperInputs inputs, mapping::MapWriter writer,
             const mapping::SubmapConfig& config, std::unique_ptr<dds::MapPublisher> publisher,
             int kept_submaps);
  MapperLoop(const MapperLoop&) = delete;
  MapperLoop& operator=(const MapperLoop&) = delete;
  ~MapperLoop();

  /// Continues what an earlier process of this session has left.
  void recover();
  /// Runs until a stop signal has arrived and the ring is empty; then completes the map. Returns the exit
  /// status.
  int run();

 private:
  void take_keyframes();
  void write(const mapping::Submap& submap);
  void publish(const mapping::Submap& submap);
  void return_submap(const mapping::Submap& submap);
  void add_pose(core::Time stamp, const core::SE3& T_map_submap);
  void publish_local_map(core::Time now);
  void report_failure(const std::string& message);
  bool wait();

  pid_t parent_;
  int signals_;
  MapperInputs inputs_;
  mapping::MapWriter writer_;
  mapping::OpenKeyframes open_keyframes_;
  mapping::SubmapBuilder builder_;
  std::unique_ptr<dds::MapPublisher> publisher_;
  int kept_submaps_;
  std::unique_ptr<ipc::ScanCloud> scan_ = std::make_unique<ipc::ScanCloud>();
  std::unique_ptr<ipc::SubmapCloud> returned_ = std::make_unique<ipc::SubmapCloud>();
  mapping::Keyframe keyframe_;  // refilled
  std::vector<dds::SurfacePoint> points_;
  dds::Path poses_;
  core::Time local_map_due_;
  core::Time refresh_due_;
  bool local_map_changed_ = false;
  bool failure_logged_ = false;
};

}  // namespace nilio::daemon
