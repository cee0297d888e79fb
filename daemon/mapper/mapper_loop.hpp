#pragma once

#include "nilio/core/time.hpp"

#include "daemon/mapper/localisation_thread.hpp"
#include "daemon/mapper/loop_thread.hpp"
#include "daemon/mapper/map_frame.hpp"
#include "ipc/dds/map_publisher.hpp"
#include "ipc/mapper_process.hpp"
#include "ipc/overwriting_ring.hpp"
#include "ipc/scan_cloud.hpp"
#include "ipc/shared_object.hpp"
#include "ipc/wake_event.hpp"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <sys/types.h>
#include <vector>

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

struct MapperLoopConfig {
  mapping::SubmapConfig submaps;
  int kept_submaps = 20;  ///< clouds that the publisher keeps for late subscribers
  bool closes_loops = true;
  std::filesystem::path saved_map;          ///< to localise in; empty: none
  bool continues_run = false;               ///< see LocalisationThreadConfig
  std::filesystem::path localisation_file;  ///< results of localisation; empty: none
  bool keeps_all = false;                   ///< see LocalisationThreadConfig
};

/// Main loop of nilio-mapper: keyframes to submaps, submaps to disk and DDS, in one thread at normal
/// priority; while it works, keyframes wait in the ring, or are overwritten and counted. Loops are closed in
/// another thread.
class MapperLoop {
 public:
  /// `parent`: end with this process; 0 = none. `signals`: signalfd of the stop signals. `writer`: empty: no
  /// map is written. `publisher` may be null.
  MapperLoop(pid_t parent, int signals, MapperInputs inputs, std::optional<mapping::MapWriter> writer,
             const MapperLoopConfig& config, std::unique_ptr<dds::MapPublisher> publisher);
  MapperLoop(const MapperLoop&) = delete;
  MapperLoop& operator=(const MapperLoop&) = delete;
  ~MapperLoop();

  /// Continues what an earlier process of this session has left.
  void recover();
  /// Runs until a stop signal has arrived and the ring is empty; then completes the map, and its loops as far
  /// as there is time. Returns the exit status; ends the process if a search is still under way.
  int run();

 private:
  void take_keyframes();
  void take_loops();
  void take_localisation();
  void apply(const mapping::Localisation& result);
  void write_localisation(const mapping::Localisation& result);
  void end_localisation(const std::string& cause);
  void finish_localisation();
  [[nodiscard]] bool has_map_frame() const;
  [[nodiscard]] std::int64_t end_ns() const;
  bool finish_loops();
  void recover_map();
  void write(const mapping::Submap& submap);
  bool write_file(const mapping::Submap& submap);
  void return_submap(const mapping::Submap& submap);
  void publish(const mapping::Submap& submap, const core::SE3& T_map_submap);
  void publish_moved();
  void publish_poses();
  void publish_transform(core::Time now);
  void publish_local_map(core::Time now);
  void report_failure(const std::string& message);
  bool wait();

  pid_t parent_;
  int signals_;
  MapperInputs inputs_;
  std::optional<mapping::MapWriter> writer_;
  std::optional<mapping::OpenKeyframes> open_keyframes_;
  mapping::SubmapBuilder builder_;
  std::unique_ptr<dds::MapPublisher> publisher_;
  std::size_t kept_submaps_;
  MapFrame frame_;
  std::map<std::uint32_t, core::SE3> cloud_poses_;  ///< T_map_submap of the kept clouds
  std::optional<std::size_t> next_moved_;           ///< next cloud to publish again
  std::unique_ptr<ipc::ScanCloud> scan_ = std::make_unique<ipc::ScanCloud>();
  std::unique_ptr<ipc::SubmapCloud> returned_ = std::make_unique<ipc::SubmapCloud>();
  mapping::Keyframe keyframe_;  // refilled
  std::vector<dds::SurfacePoint> points_;
  core::Time local_map_due_;
  core::Time refresh_due_;
  core::Time transform_at_;
  bool local_map_changed_ = false;
  bool failure_logged_ = false;
  std::unique_ptr<LocalisationThread> localisation_;  ///< null: no saved map, or it cannot be used
  std::string saved_map_;                             ///< its name and identity
  mapping::LocalisationState localisation_state_ = mapping::LocalisationState::kSearching;
  std::string localisation_refusal_;  ///< of the last search
  std::filesystem::path localisation_path_;
  std::ofstream localisation_file_;
  std::unique_ptr<LoopThread> loops_;  ///< reads writer_; null: loops are not closed
};

}  // namespace nilio::daemon
