#pragma once

#include "ipc/dds/cloud_subscriber.hpp"
#include "ipc/dds/odometry_subscriber.hpp"
#include "ipc/messages/messages.hpp"
#include "tools/view/frames.hpp"
#include "tools/view/live_state.hpp"
#include "tools/view/point_tiles.hpp"
#include "tools/view/server.hpp"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace nilio::tools::view {

/// Points of a received cloud: float32 fields x, y, z, and intensity if there is one. Empty where the message
/// contradicts itself, points that are not finite are left out.
std::vector<ViewPoint> points_of(const dds::PointCloud2& cloud);

/// Serves what a DDS subscriber receives: state ten times a second, summaries once a second, and the clouds
/// as fast as a client takes them. Also `/metrics`.
class LiveContent : public Content {
 public:
  LiveContent(std::unique_ptr<dds::OdometrySubscriber> subscriber,
              const dds::OdometrySubscriberConfig& config);

  /// The server whose counters `/metrics` has; it outlives the requests.
  void set_server(const Server& server) { server_ = &server; }
  std::optional<Response> get(std::string_view path, std::string_view accept) override;
  FramePtr next_frame(PageClient& client) override;
  void tick(std::vector<PageClient*>& clients) override;
  [[nodiscard]] const LiveState& state() const { return state_; }

 private:
  void receive();
  void receive_clouds();
  void subscribe_to_clouds(bool has_clients);
  void send(PageClient& client, const nlohmann::json& message) const;
  void greet(PageClient& client) const;

  std::unique_ptr<dds::OdometrySubscriber> subscriber_;
  dds::CloudSubscriberConfig cloud_config_;
  /// Only while a page is connected, and a minute longer: clouds cost every process on their way.
  std::unique_ptr<dds::CloudSubscriber> clouds_;
  std::int64_t last_client_ns_ = 0;
  LiveState state_;
  PointTiles tiles_;
  FramePtr scan_;
  std::uint64_t scan_number_ = 0;
  std::uint64_t drive_ = 0;
  std::int64_t next_state_ns_ = 0;
  std::int64_t next_summary_ns_ = 0;
  std::string place_;
  const Server* server_ = nullptr;
};

}  // namespace nilio::tools::view
